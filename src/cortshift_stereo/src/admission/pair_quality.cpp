#include "cortshift_stereo/admission/pair_quality.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cortshift_flow/text.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::shortNumber;

double standardDeviation(const cv::Mat& image) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0];
}

double variance(const cv::Mat& image) {
  const double deviation = standardDeviation(image);
  return deviation * deviation;
}

/// Standard deviation of white noise [grey levels]: the median size of a second difference both ways, which a blurred
/// image has nothing else in (Immerkaer 1996).
double noiseOf(const cv::Mat& grey) {
  const cv::Matx33f kernel(1, -2, 1, -2, 4, -2, 1, -2, 1);
  cv::Mat difference;
  cv::filter2D(grey, difference, CV_32F, kernel);
  std::vector<float> sizes;
  for (int y = 1; y + 1 < difference.rows; y += 2)
    for (int x = 1; x + 1 < difference.cols; x += 2) sizes.push_back(std::abs(difference.at<float>(y, x)));
  if (sizes.empty()) return 0;
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return 1.4826 * static_cast<double>(*middle) / 6;  // 6: root of the kernel's sum of squares
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
  const cv::Mat two_half = half(two), four = smooth(two_half, std::sqrt(12.0) / 2);
  const cv::Mat four_half = half(four), eight = smooth(four_half, std::sqrt(48.0) / 4);
  quality.sharpness = standardDeviation(one - two) / std::max(1e-6, standardDeviation(four_half - eight));
  // White noise of variance 1 leaves 1 / (4 pi s^2) behind a Gaussian of deviation s, and of the difference of two
  // 1 / (4 pi) (1 / s^2 + 1 / t^2 - 4 / (s^2 + t^2)): 0.0090 for 2 and 4 px, 0.0022 for 4 and 8.
  const double noise2 = noiseOf(values) * noiseOf(values);
  const double fine = std::max(0.0, variance(two_half - four) - 0.0090 * noise2);
  const double coarse = std::max(1e-6, variance(four_half - eight) - 0.0022 * noise2);
  quality.detail = std::sqrt(fine / coarse);
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

Findings checkAlikeSharp(const ImageQuality& left, const ImageQuality& right, const PairLimits& limits) {
  Findings found;
  const bool left_worse = left.detail < right.detail;
  const double less = left_worse ? left.detail : right.detail, more = left_worse ? right.detail : left.detail;
  if (more > limits.max_sharpness_ratio * less)
    found.refuse(CheckId::kDefocused, std::string("The ") + (left_worse ? "left" : "right") + " image",
                 "is blurred against the other one (detail " + shortNumber(less) + " against " + shortNumber(more) +
                     ", at most " + shortNumber(limits.max_sharpness_ratio) + " times as much is allowed)",
                 "check the focus and the lens of that camera");
  return found;
}

namespace {

constexpr int kFewestPoints = 20;
constexpr double kSureSds = 4;  // standard errors: 1 in 16000 by chance
constexpr double kDegrees = 180 / CV_PI;
// Rows tell a turn about the vertical axis by little (0.4 px in the corners for 0.5 deg), and so does what a
// calibration leaves of the distortion: warned of, and refused where it is far beyond that.
constexpr double kDoubtfulTurnY = 0.15 / kDegrees, kMostTurnY = 0.3 / kDegrees;

std::string degrees(double radians) { return shortNumber(kDegrees * std::abs(radians)) + " deg"; }

}  // namespace

RowVerdict judgeRows(const RowAgreement& rows, const PairLimits& limits) {
  RowVerdict verdict;
  Findings& found = verdict.findings;
  if (rows.matched < kFewestPoints) {
    found.refuse(CheckId::kNoMatch, "The match",
                 "rests on only " + std::to_string(rows.matched) + " points found in both images, at least " +
                     std::to_string(kFewestPoints) + " are needed to trust the pair",
                 "check that both images show the same scene, and the calibration");
    return verdict;
  }
  constexpr double kPlainlyBetter = 0.5, kLeastGap = 0.5;  // [px]
  if (rows.spread_as_is > kLeastGap && rows.spread_if_swapped < kPlainlyBetter * rows.spread_as_is)
    found.refuse(CheckId::kSwapped, "Left and right",
                 "are swapped: the rows of the two images agree to " + shortNumber(rows.spread_if_swapped) +
                     " px when exchanged, but to " + shortNumber(rows.spread_as_is) + " px as they are",
                 "exchange the cables or the topics");
  const std::string images = "The rows of the two images", camera = "The right camera";
  const std::string remedy = "the images are not of one pair, or a camera moved since its calibration; calibrate again";
  if (rows.spread > limits.max_epipolar_residual)
    found.refuse(CheckId::kEpipolar, images,
                 "do not agree (vertical gaps of " + std::to_string(rows.matched) + " points scatter by " +
                     shortNumber(rows.spread) + " px, at most " + shortNumber(limits.max_epipolar_residual) +
                     " px is allowed)",
                 remedy);
  if (rows.misalignment.surely(kSureSds) > limits.max_misalignment)
    found.refuse(CheckId::kEpipolar, images,
                 "do not agree: the right camera is turned by " +
                     degrees(std::hypot(rows.turn_x.value, rows.turn_z.value)) +
                     " against its calibration (rows off by " + shortNumber(rows.misalignment.value) +
                     " px, standard error " + shortNumber(rows.misalignment.sd) + ", at most " +
                     shortNumber(limits.max_misalignment) + " px can be taken out)",
                 remedy);
  if (std::abs(rows.turn_y.surely(kSureSds)) > kMostTurnY)
    found.refuse(CheckId::kEpipolar, camera,
                 "is turned about the vertical axis by " + degrees(rows.turn_y.value) + " (standard error " +
                     shortNumber(kDegrees * rows.turn_y.sd) +
                     " deg) against its calibration, which changes every depth",
                 remedy);
  // A row that is off by this much shifts a match along a slanting vessel by as much: 0.1 mm at 300 mm.
  constexpr double kWorthIt = 0.15;  // [px]
  if (rows.misalignment.surely(kSureSds) > kWorthIt) verdict.turn = cv::Vec3d(rows.turn_x.value, 0, rows.turn_z.value);
  return verdict;
}

Findings warningsOfRows(const RowAgreement& rows, const cv::Vec3d& taken, const StereoModel& model, double depth) {
  Findings found;
  const double turn = cv::norm(taken), focal = model.right.P(1, 1);
  const auto depthError = [&](double by) {
    return shortNumber(1e3 * depth * depth / model.baseline() * std::abs(by)) + " mm";
  };
  const std::string camera = "The right camera", remedy = "calibrate again";
  if (turn > 0)
    found.warn(CheckId::kEpipolar, camera,
               "is turned by " + degrees(turn) + " against its calibration (" + degrees(taken[0]) +
                   " about the horizontal axis, rows off by " + shortNumber(focal * std::abs(taken[0])) + " px, and " +
                   degrees(taken[2]) + " about the optical axis); this was taken out, but a turn about the vertical " +
                   "axis does not show in the rows, and one as large makes depths wrong by " + depthError(turn),
               remedy);
  if (std::abs(rows.turn_y.surely(kSureSds)) > kDoubtfulTurnY)
    found.warn(CheckId::kEpipolar, camera,
               "seems to be turned about the vertical axis by " + degrees(rows.turn_y.value) + " (standard error " +
                   shortNumber(kDegrees * rows.turn_y.sd) +
                   " deg) against its calibration, which makes depths wrong by " + depthError(rows.turn_y.value),
               remedy);
  return found;
}

}  // namespace cortshift_stereo
