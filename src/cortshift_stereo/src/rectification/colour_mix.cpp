#include "rectification/colour_mix.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace cortshift_stereo {
namespace {

constexpr std::size_t kFewest = 500;       // places; fewer cannot tell
constexpr double kQuantisation = 1. / 12;  // variance of rounding to grey levels
constexpr double kLargestGain = 4;
constexpr int kSteps = 20;            // weights are multiples of its inverse
constexpr double kWorthwhile = 0.98;  // of the error of the colours' mean
constexpr double kSameWhite = 1.02;   // ratio of the colours' gains: less is the light's, not the cameras'
constexpr int kBlock = 64;            // [px] side of a block: light and tissue differ over the image
constexpr double kLeastClear = 0.1;   // of signal against noise: there the matching and the sheet's stiffness decide

/// What makes a right colour that of the left. The ratio of the means: deviations would take the lamp's unequal light
/// for the cameras' contrast. A black level is left to the offset that the refinement finds from place to place.
double gainOf(const std::vector<ColourPair>& pairs, int channel) {
  double left = 1, right = 1;  // of black images too
  for (const ColourPair& pair : pairs) {
    left += pair.left[channel];
    right += pair.right[channel];
  }
  return std::clamp(left / right, 1 / kLargestGain, kLargestGain);
}

/// A full pixel has no noise, but no tissue either.
bool isSaturated(const ColourPair& pair) {
  constexpr float kFull = 250;
  bool full = false;
  for (int c = 0; c < 3; ++c) full |= pair.left[c] > kFull || pair.right[c] > kFull;
  return full;
}

/// Variance of a noise with few large outliers.
double robustVariance(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  const double deviation = 1.4826 * static_cast<double>(*middle);
  return deviation * deviation + kQuantisation;
}

}  // namespace

ColourMix chooseMix(const std::vector<ColourPair>& pairs) {
  ColourMix mix;
  if (pairs.size() < kFewest) return mix;
  cv::Vec3d gain, variance;
  for (int c = 0; c < 3; ++c) {
    gain[c] = gainOf(pairs, c);
    std::vector<float> differences;
    differences.reserve(pairs.size());
    for (const ColourPair& pair : pairs)
      differences.push_back(std::abs(pair.left_slope[c] - static_cast<float>(gain[c]) * pair.right_slope[c]));
    variance[c] = robustVariance(std::move(differences));
  }

  cv::Matx33d N = cv::Matx33d::zeros();
  double total = 0;
  struct Block {
    cv::Matx33d S = cv::Matx33d::zeros();
    double places = 0;
  };
  std::map<std::pair<int, int>, Block> blocks;
  for (const ColourPair& pair : pairs) {
    const cv::Vec3d left = pair.left_slope, right = cv::Vec3d(pair.right_slope).mul(gain), difference = left - right;
    double outlying = 0;
    for (int c = 0; c < 3; ++c) outlying += difference[c] * difference[c] / variance[c] / 3;
    constexpr double kOutlier = 9;  // three deviations: a quarter of the weight
    const double weight = 1 / ((1 + outlying / kOutlier) * (1 + outlying / kOutlier));
    Block& block = blocks[{pair.place.y / kBlock, pair.place.x / kBlock}];
    block.S += weight * 0.5 * (left * right.t() + right * left.t());
    block.places += weight;
    if (isSaturated(pair)) continue;
    N += weight * (difference * difference.t());
    total += weight;
  }
  N = N * (1 / std::max(1.0, total)) + kQuantisation * cv::Matx33d::eye();

  /// Mean expected error of a mix, but for a factor.
  const auto error = [&](const cv::Vec3d& w) {
    double sum = 0;
    for (const auto& [place, block] : blocks)
      sum += block.places / std::sqrt(std::max(0.0, w.dot(block.S * w)) / (block.places * w.dot(N * w)) + kLeastClear);
    return sum;
  };
  const cv::Vec3d mean(1. / 3, 1. / 3, 1. / 3);
  cv::Vec3d best = mean;
  double least = kWorthwhile * error(best);
  for (int b = 0; b <= kSteps; ++b)
    for (int g = 0; b + g <= kSteps; ++g) {
      const cv::Vec3d w = cv::Vec3d(b, g, kSteps - b - g) / kSteps;
      if (const double value = error(w); value < least) {
        least = value;
        best = w;
      }
    }
  // One gain for all colours is found from place to place by the refinement.
  const auto [least_gain, most_gain] = std::minmax({gain[0], gain[1], gain[2]});
  if (best == mean && most_gain < kSameWhite * least_gain) return mix;
  mix.left = best;
  mix.right = best.mul(gain);
  return mix;
}

}  // namespace cortshift_stereo
