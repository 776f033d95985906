#include "cortshift_tracking/trust/agreement.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "cortshift_flow/flow.hpp"
#include "cortshift_flow/range.hpp"
#include "cortshift_tracking/error.hpp"
#include "matching/flow_targets.hpp"
#include "matching/window_mean.hpp"
#include "parallel.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kHueWindow = 0.3;  // side over that of the other windows: colour needs fewer pixels than a pattern
constexpr float kDarkest = 0.01F;   // a darker colour has no meaningful ratio

cv::Mat luminance(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

/// Logarithms of the window's mean blue and red over green, blue first.
std::vector<cv::Mat> logRatios(const cv::Mat& colour, const WindowMean& window) {
  std::vector<cv::Mat> channels;
  cv::split(colour, channels);
  for (cv::Mat& channel : channels) cv::log(cv::max(window.of(channel), kDarkest), channel);
  return {channels[0] - channels[1], channels[2] - channels[1]};
}

/// Median over every fourth pixel of every fourth row that counts; 0 if there is none.
float median(const cv::Mat& values, const cv::Mat& weight) {
  constexpr int kStep = 4;
  std::vector<float> all;
  for (int row = 0; row < values.rows; row += kStep)
    for (int column = 0; column < values.cols; column += kStep)
      if (weight.at<float>(row, column) > 0) all.push_back(values.at<float>(row, column));
  if (all.empty()) return 0;
  const auto middle = all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2);
  std::nth_element(all.begin(), middle, all.end());
  return *middle;
}

/// A change of the lamp's colour or of the camera's white balance is the same everywhere: it is subtracted.
cv::Mat hueChange(const cv::Mat& first, const cv::Mat& second, const WindowMean& window) {
  const std::vector<cv::Mat> before = logRatios(first, window), after = logRatios(second, window);
  cv::Mat squares = cv::Mat::zeros(first.size(), CV_32FC1), change;
  for (std::size_t i = 0; i < before.size(); ++i) {
    cv::subtract(after[i], before[i], change);
    change -= median(change, window.weight());
    squares += change.mul(change);
  }
  cv::sqrt(squares, squares);
  return squares;
}

cv::Mat bendOf(const cv::Mat& flow, double resolution, const WindowMean& everywhere) {
  std::vector<cv::Mat> parts;
  cv::split(flow, parts);
  cv::Mat squares = cv::Mat::zeros(flow.size(), CV_32FC1);
  for (const cv::Mat& part : parts) {
    const cv::Mat deviation = part - everywhere.of(part);
    squares += deviation.mul(deviation);
  }
  cv::Mat bend;
  cv::sqrt(everywhere.of(squares), bend);
  return bend * resolution;
}

float logistic(float logit) { return 1 / (1 + std::exp(-logit)); }

float logWithin(float value, float low, float high) { return std::log(std::clamp(value, low, high)); }

}  // namespace

void AgreementSettings::validate() const {
  cortshift_flow::requireRange<TrackingError>("match_window", window, 0.0005, 0.02);
  cortshift_flow::requireRange<TrackingError>("image_noise", image_noise, 0.0, 0.2);
}

Agreement agreementOf(const Seen& first, const Seen& second, const cv::Mat& flow, double resolution,
                      const AgreementSettings& settings) {
  settings.validate();
  const cv::Mat map = flowTargets(flow);
  const cv::Mat a = luminance(first.pattern);
  cv::Mat b, second_colour, weight;
  cv::remap(luminance(second.pattern), b, map, {}, cv::INTER_LINEAR, cv::BORDER_CONSTANT, 0);
  cv::remap(second.colour, second_colour, map, {}, cv::INTER_LINEAR, cv::BORDER_CONSTANT, 0);
  cv::remap(second.usable, weight, map, {}, cv::INTER_NEAREST, cv::BORDER_CONSTANT, 0);
  weight &= first.usable;
  weight.convertTo(weight, CV_32F, 1.0 / 255.0);

  const WindowMean window(weight, settings.window, resolution);
  const cv::Mat mean_a = window.of(a), mean_b = window.of(b), mean_aa = window.of(a.mul(a)),
                mean_bb = window.of(b.mul(b)), mean_ab = window.of(a.mul(b));
  const auto noise = static_cast<float>(settings.image_noise * settings.image_noise);
  Agreement agreement;
  agreement.correlation = cv::Mat::zeros(a.size(), CV_32FC1);
  agreement.residual = cv::Mat(a.size(), CV_32FC1, cv::Scalar(1));
  agreement.hue = hueChange(first.colour, second_colour, {weight, kHueWindow * settings.window, resolution});
  agreement.bend = bendOf(flow, resolution, {cv::Mat::ones(a.size(), CV_32FC1), settings.window, resolution});
  for (int row = 0; row < a.rows; ++row)
    for (int column = 0; column < a.cols; ++column) {
      if (weight.at<float>(row, column) == 0 || window.share().at<float>(row, column) < WindowMean::kLeastShare)
        continue;
      const float ma = mean_a.at<float>(row, column), mb = mean_b.at<float>(row, column);
      const float va = std::max(0.0F, mean_aa.at<float>(row, column) - ma * ma),
                  vb = std::max(0.0F, mean_bb.at<float>(row, column) - mb * mb),
                  cross = mean_ab.at<float>(row, column) - ma * mb;
      // The noise in the denominator makes the correlation small where there is little texture.
      agreement.correlation.at<float>(row, column) = cross / std::sqrt((va + noise) * (vb + noise));
      agreement.residual.at<float>(row, column) = std::sqrt(std::max(0.0F, va + vb - 2 * cross));
    }
  return agreement;
}

// Both models were fitted to vectors between the stages of cases generated for it; the cases of the benchmark, the demo
// and the theatre were not among them. Logarithms are cut off where the fit had no data.

float probabilityOfMatch(const MatchEvidence& evidence) {
  if (!std::isfinite(evidence.flow_error)) return 0;  // there is no flow to judge
  return logistic(-21.91F - 0.6251F * logWithin(evidence.flow_error, 3e-6F, 1e-3F) + 4.531F * evidence.correlation -
                  0.7433F * logWithin(evidence.residual, 0.002F, 0.2F) -
                  0.4316F * logWithin(evidence.hue, 0.01F, 1.0F) - 1.054F * logWithin(evidence.bend, 5e-6F, 5e-4F));
}

float probabilityOfHeight(const HeightEvidence& evidence) {
  constexpr float kRight = 0.00025F;  // [m]
  // What surfaces expect is too little on weak texture, the worst case of config/phantom/fit: with 1.2 times as much,
  // its vectors are wrong at most 1.3 times as often as they say (shift_benchmark, see BENCHMARK.md).
  constexpr float kExpectedTooLittle = 1.2F;
  const float of_one_thing = logistic(-10.39F - 1.505F * logWithin(evidence.roughness, 2e-6F, 1e-3F)),
              deviation = kExpectedTooLittle * std::max(evidence.deviation, 1e-9F);
  return of_one_thing * std::erf(kRight / (std::sqrt(2.0F) * deviation));
}

cv::Mat probabilityOfMatch(const cv::Mat& flow_confidence, const Agreement& agreement, double resolution) {
  cv::Mat probability(flow_confidence.size(), CV_32FC1);
  parallelRanges(probability.rows, 0, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int column = 0; column < probability.cols; ++column) {
        const double flow_error = cortshift_flow::predictedError(flow_confidence.at<float>(row, column));
        probability.at<float>(row, column) =
            probabilityOfMatch({static_cast<float>(flow_error * resolution),
                                agreement.correlation.at<float>(row, column), agreement.residual.at<float>(row, column),
                                agreement.hue.at<float>(row, column), agreement.bend.at<float>(row, column)});
      }
  });
  return probability;
}

}  // namespace cortshift_tracking
