#include "cortshift_stereo/admission/pair_quality.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::shortNumber;

double standardDeviation(const cv::Mat& image) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0];
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

cv::Point2f rawPosition(const cv::Mat& map, const cv::Point2f& rectified) {
  const int x = std::min(static_cast<int>(rectified.x), map.cols - 2);
  const int y = std::min(static_cast<int>(rectified.y), map.rows - 2);
  const float u = rectified.x - static_cast<float>(x), v = rectified.y - static_cast<float>(y);
  const auto at = [&](int dx, int dy) { return map.at<cv::Vec2f>(y + dy, x + dx); };
  const cv::Vec2f raw = (1 - v) * ((1 - u) * at(0, 0) + u * at(1, 0)) + v * ((1 - u) * at(0, 1) + u * at(1, 1));
  return {raw[0], raw[1]};
}

}  // namespace

ImageQuality measureImage(const cv::Mat& image) {
  CV_Assert(image.type() == CV_8UC3);
  constexpr int kSaturated = 250, kRowStep = 2;
  int64_t sum = 0, squares = 0;
  int count = 0, saturated = 0;
  for (int y = 0; y < image.rows; y += kRowStep) {
    const uint8_t* row = image.ptr<uint8_t>(y);
    for (int x = 0; x < 3 * image.cols; x += 3) {
      const int value = row[x] + row[x + 1] + row[x + 2];
      sum += value;
      squares += value * value;
      saturated += (row[x] >= kSaturated) + (row[x + 1] >= kSaturated) + (row[x + 2] >= kSaturated) >= 2;
    }
    count += image.cols;
  }
  const double mean = static_cast<double>(sum) / count;
  ImageQuality quality;
  quality.contrast = std::sqrt(std::max(0.0, static_cast<double>(squares) / count - mean * mean)) / 3;
  quality.saturated_share = static_cast<double>(saturated) / count;

  // Focus is judged in the middle, where the surgeon looks.
  constexpr int kMiddle = 512;
  const cv::Size middle(std::min(image.cols, kMiddle), std::min(image.rows, kMiddle));
  cv::Mat grey, values;
  cv::cvtColor(image(cv::Rect({(image.cols - middle.width) / 2, (image.rows - middle.height) / 2}, middle)), grey,
               cv::COLOR_BGR2GRAY);
  grey.convertTo(values, CV_32F);
  const auto smooth = [](const cv::Mat& from, double sigma) {
    cv::Mat out;
    cv::GaussianBlur(from, out, {}, sigma);
    return out;
  };
  const auto half = [](const cv::Mat& from) {
    cv::Mat out;
    cv::resize(from, out, {}, 0.5, 0.5, cv::INTER_AREA);
    return out;
  };
  const cv::Mat one = smooth(values, 1), two = smooth(one, std::sqrt(3.0));
  const cv::Mat four = half(smooth(half(two), std::sqrt(12.0) / 2)), eight = smooth(four, std::sqrt(48.0) / 4);
  quality.sharpness = standardDeviation(one - two) / std::max(1e-6, standardDeviation(four - eight));
  return quality;
}

Findings checkImage(const ImageQuality& quality, const PairLimits& limits, const std::string& side) {
  Findings found;
  const std::string image = "The " + side + " image";
  if (quality.contrast < limits.min_contrast)
    found.refuse(CheckId::kBlank, image,
                 "is blank (contrast " + shortNumber(quality.contrast) + " grey levels, at least " +
                     shortNumber(limits.min_contrast) + " are needed)",
                 "check the light, the exposure and the beam splitter");
  if (quality.saturated_share > limits.max_saturated_share)
    found.refuse(CheckId::kSaturated, image,
                 "is saturated (" + shortNumber(100 * quality.saturated_share) + " % of its pixels, at most " +
                     shortNumber(100 * limits.max_saturated_share) + " % are allowed)",
                 "lower the exposure or the light");
  if (quality.sharpness < limits.min_sharpness)
    found.refuse(CheckId::kDefocused, image,
                 "is out of focus (sharpness " + shortNumber(quality.sharpness) + ", at least " +
                     shortNumber(limits.min_sharpness) + " is needed)",
                 "focus the microscope");
  return found;
}

Findings checkSameImage(const cv::Mat& raw, const cv::Mat& decompressed, const std::string& side) {
  Findings found;
  const std::string thing = "The raw and the compressed image of the " + side + " camera";
  const std::string remedy = "two sources publish under one name; stop the one that is wrong";
  if (raw.size() != decompressed.size()) {
    found.refuse(CheckId::kRawAndCompressed, thing, "have one stamp and different sizes", remedy);
    return found;
  }
  // Blocks of 8 pixels are what JPEG keeps best: at quality 50 their means stay within 2 grey levels.
  constexpr double kLoss = 4;  // [grey levels] root mean square
  cv::Mat a, b, difference;
  const cv::Size blocks(std::max(1, raw.cols / 8), std::max(1, raw.rows / 8));
  cv::resize(raw, a, blocks, 0, 0, cv::INTER_AREA);
  cv::resize(decompressed, b, blocks, 0, 0, cv::INTER_AREA);
  const double rms = cv::norm(a, b, cv::NORM_L2) / std::sqrt(static_cast<double>(3 * a.total()));
  if (rms > kLoss)
    found.refuse(CheckId::kRawAndCompressed, thing,
                 "have one stamp and differ by " + shortNumber(rms) + " grey levels (compression alone: at most " +
                     shortNumber(kLoss) + ")",
                 remedy);
  return found;
}

EpipolarResidual measureEpipolarResidual(const RectifiedPair& pair, const cv::Mat& disparity,
                                         const Rectifier& rectifier) {
  const cv::Mat &left = pair.left_sharp, &right = pair.right_sharp;
  constexpr int kCorners = 300;
  std::vector<cv::Point2f> corners, from, found;
  cv::Mat half, half_usable;
  cv::resize(left, half, {}, 0.5, 0.5, cv::INTER_AREA);
  cv::resize(pair.left_usable, half_usable, half.size(), 0, 0, cv::INTER_NEAREST);
  cv::goodFeaturesToTrack(half, corners, kCorners, 0.01, std::max(5.0, half.cols / 64.0), half_usable, 3);
  for (cv::Point2f& corner : corners) {
    corner = 2 * corner + cv::Point2f(0.5f, 0.5f);
    const float d = disparity.at<float>(cvRound(corner.y), cvRound(corner.x));
    if (!std::isfinite(d)) continue;
    from.push_back(corner);
    found.emplace_back(corner.x - d, corner.y);
  }
  EpipolarResidual residual;
  if (from.empty()) return residual;
  std::vector<uint8_t> status;
  std::vector<float> error;
  cv::calcOpticalFlowPyrLK(left, right, from, found, status, error, {15, 15}, 2,
                           cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 15, 0.02),
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  std::vector<cv::Point2d> left_raw, right_raw;
  std::vector<double> signed_gaps, gaps;
  const cv::Rect2f inside(0, 0, static_cast<float>(left.cols - 1), static_cast<float>(left.rows - 1));
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (!status[i] || !inside.contains(found[i])) continue;
    signed_gaps.push_back(found[i].y - from[i].y);
    gaps.push_back(std::abs(signed_gaps.back()));
    left_raw.push_back(rawPosition(rectifier.leftMap(), from[i]));
    right_raw.push_back(rawPosition(rectifier.rightMap(), found[i]));
  }
  residual.matched = static_cast<int>(gaps.size());
  if (gaps.empty()) return residual;
  residual.offset = median(signed_gaps);
  residual.spread = median(gaps);
  const std::vector<cv::Point2d> left_as_right = rectifyPoints(rectifier.model().right, left_raw);
  const std::vector<cv::Point2d> right_as_left = rectifyPoints(rectifier.model().left, right_raw);
  for (std::size_t i = 0; i < gaps.size(); ++i) gaps[i] = std::abs(left_as_right[i].y - right_as_left[i].y);
  residual.spread_if_swapped = median(gaps);
  return residual;
}

}  // namespace cortshift_stereo
