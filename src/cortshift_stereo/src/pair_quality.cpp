#include "cortshift_stereo/pair_quality.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

namespace cortshift_stereo {
namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

double standardDeviation(const cv::Mat& image) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0];
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

}  // namespace

ImageQuality measureImage(const cv::Mat& image) {
  CV_Assert(image.type() == CV_8UC3);
  // A reduced image has its detail at the same place of its spectrum if it was in focus; this one pixel in two rows
  // and columns is enough for statistics and keeps the check cheap.
  cv::Mat grey, values;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  grey.convertTo(values, CV_32F);
  const auto smooth = [](const cv::Mat& from, double sigma) {
    cv::Mat out;
    cv::GaussianBlur(from, out, {}, sigma);
    return out;
  };
  const cv::Mat one = smooth(values, 1), two = smooth(values, 2);
  cv::Mat half;
  cv::resize(two, half, {}, 0.5, 0.5, cv::INTER_AREA);
  const cv::Mat four = smooth(half, std::sqrt(12.0) / 2);
  cv::Mat quarter;
  cv::resize(four, quarter, {}, 0.5, 0.5, cv::INTER_AREA);
  const cv::Mat eight = smooth(quarter, std::sqrt(48.0) / 4);

  std::vector<cv::Mat> channels;
  cv::split(image, channels);
  constexpr int kSaturated = 250;
  const cv::Mat brightest = cv::max(cv::max(channels[0], channels[1]), channels[2]);
  ImageQuality quality;
  quality.contrast = standardDeviation(values);
  quality.saturated_share =
      static_cast<double>(cv::countNonZero(brightest >= kSaturated)) / static_cast<double>(image.total());
  quality.sharpness = standardDeviation(one - two) / std::max(1e-6, standardDeviation(quarter - eight));
  return quality;
}

void checkImage(const ImageQuality& quality, const PairLimits& limits, const std::string& side) {
  if (quality.contrast < limits.min_contrast)
    throw PairError("blank", "The " + side + " image is blank (contrast " + number(quality.contrast) +
                                 " grey levels, at least " + number(limits.min_contrast) +
                                 " are needed): check the light, the exposure and the beam splitter.");
  if (quality.saturated_share > limits.max_saturated_share)
    throw PairError("saturated", "The " + side + " image is saturated (" + number(100 * quality.saturated_share) +
                                     " % of its pixels, at most " + number(100 * limits.max_saturated_share) +
                                     " % are allowed): lower the exposure or the light.");
  if (quality.sharpness < limits.min_sharpness)
    throw PairError("defocused", "The " + side + " image is out of focus (sharpness " + number(quality.sharpness) +
                                     ", at least " + number(limits.min_sharpness) +
                                     " is needed): focus the microscope.");
}

EpipolarResidual measureEpipolarResidual(const RectifiedPair& pair, const cv::Mat& disparity) {
  cv::Mat left, right;
  pair.left.convertTo(left, CV_8U);
  pair.right.convertTo(right, CV_8U);
  constexpr int kCorners = 400;
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(left, corners, kCorners, 0.01, std::max(8.0, left.cols / 64.0), pair.left_usable, 5);
  std::vector<cv::Point2f> start, found;
  std::vector<cv::Point2f> from;
  for (const cv::Point2f& corner : corners) {
    const float d = disparity.at<float>(cvRound(corner.y), cvRound(corner.x));
    if (!std::isfinite(d)) continue;
    from.push_back(corner);
    start.emplace_back(corner.x - d, corner.y);
  }
  EpipolarResidual residual;
  if (from.empty()) return residual;
  found = start;
  std::vector<uint8_t> status;
  std::vector<float> error;
  cv::calcOpticalFlowPyrLK(left, right, from, found, status, error, {21, 21}, 2,
                           cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 15, 0.02),
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  std::vector<double> signed_gaps, gaps;
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (!status[i]) continue;
    signed_gaps.push_back(found[i].y - from[i].y);
    gaps.push_back(std::abs(signed_gaps.back()));
  }
  residual.matched = static_cast<int>(gaps.size());
  if (gaps.empty()) return residual;
  residual.offset = median(signed_gaps);
  residual.spread = median(gaps);
  return residual;
}

}  // namespace cortshift_stereo
