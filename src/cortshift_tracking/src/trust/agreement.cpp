#include "cortshift_tracking/trust/agreement.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

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

/// Correlation and residual.
void comparePatterns(const cv::Mat& a, const cv::Mat& b, const WindowMean& window, double image_noise,
                     Agreement& agreement) {
  const cv::Mat mean_a = window.of(a), mean_b = window.of(b), mean_aa = window.of(a.mul(a)),
                mean_bb = window.of(b.mul(b)), mean_ab = window.of(a.mul(b));
  const auto noise = static_cast<float>(image_noise * image_noise);
  agreement.correlation = cv::Mat::zeros(a.size(), CV_32FC1);
  agreement.residual = cv::Mat(a.size(), CV_32FC1, cv::Scalar(1));
  for (int row = 0; row < a.rows; ++row)
    for (int column = 0; column < a.cols; ++column) {
      if (window.weight().at<float>(row, column) == 0 ||
          window.share().at<float>(row, column) < WindowMean::kLeastShare)
        continue;
      const float ma = mean_a.at<float>(row, column), mb = mean_b.at<float>(row, column);
      const float va = std::max(0.0F, mean_aa.at<float>(row, column) - ma * ma),
                  vb = std::max(0.0F, mean_bb.at<float>(row, column) - mb * mb),
                  cross = mean_ab.at<float>(row, column) - ma * mb;
      // The noise in the denominator makes the correlation small where there is little texture.
      agreement.correlation.at<float>(row, column) = cross / std::sqrt((va + noise) * (vb + noise));
      agreement.residual.at<float>(row, column) = std::sqrt(std::max(0.0F, va + vb - 2 * cross));
    }
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

/// @param window of the pair; patterns without colour
cv::Mat apertureOf(const cv::Mat& first, const cv::Mat& second, const WindowMean& window, double resolution,
                   double image_noise) {
  constexpr double kSobel = 1.0 / 8;  // makes OpenCV's 3 x 3 kernels derivatives per pixel
  cv::Mat dx[2], dy[2];
  for (const int i : {0, 1}) {
    cv::Sobel(i == 0 ? first : second, dx[i], CV_32F, 1, 0, 3, kSobel);
    cv::Sobel(i == 0 ? first : second, dy[i], CV_32F, 0, 1, 3, kSobel);
  }
  // Of one image with the other: what only one of them shows, noise for instance, cancels out.
  const cv::Mat xx = window.of(dx[0].mul(dx[1])), yy = window.of(dy[0].mul(dy[1])),
                xy = window.of(0.5 * (dx[0].mul(dy[1]) + dx[1].mul(dy[0])));
  constexpr float kNothing = 1e-9F;                                   // below any texture that eight bits hold
  const double noise = std::sqrt(2.0) * image_noise / window.side();  // of a difference
  cv::Mat aperture(first.size(), CV_32FC1);
  parallelRanges(aperture.rows, 0, [&](int first_row, int last_row) {
    for (int row = first_row; row < last_row; ++row)
      for (int column = 0; column < aperture.cols; ++column) {
        const float half_sum = 0.5F * (xx.at<float>(row, column) + yy.at<float>(row, column)),
                    half_difference = 0.5F * (xx.at<float>(row, column) - yy.at<float>(row, column)),
                    mixed = xy.at<float>(row, column),
                    smaller = half_sum - std::sqrt(half_difference * half_difference + mixed * mixed),
                    counted = std::max(WindowMean::kLeastShare, window.share().at<float>(row, column));
        aperture.at<float>(row, column) =
            static_cast<float>(noise * resolution) / std::sqrt(counted * std::max(kNothing, smaller));
      }
  });
  return aperture;
}

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
  Agreement agreement;
  sideBySide(
      {[&] { comparePatterns(a, b, window, settings.image_noise, agreement); },
       [&] { agreement.aperture = apertureOf(a, b, window, resolution, settings.image_noise); },
       [&] {
         agreement.hue = hueChange(first.colour, second_colour, {weight, kHueWindow * settings.window, resolution});
       },
       [&] {
         agreement.bend = bendOf(flow, resolution, {cv::Mat::ones(a.size(), CV_32FC1), settings.window, resolution});
       }});
  return agreement;
}

}  // namespace cortshift_tracking
