#include "trust/judgement.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "parallel.hpp"
#include "polish/spline_grid.hpp"
#include "trust/fitted_weights.hpp"

namespace cortshift_flow {
namespace {

constexpr float kHalf = 0.25f;        // error whose probability to be exceeded the model gives [px]
constexpr float kRayleigh = 1.7183f;  // e - 1: inverse odds that an error of that root mean square exceeds it
constexpr float kLargestLogit = 9;    // beyond it the fit had no data

float logitOf(const float* cues, const FittedWeights& model) {
  float logit = model.constant;
  for (int k = 0; k < kCues; ++k) {
    const CueWeights& cue = model.cues[k];
    logit += cue.slope * cues[k];
    for (int q = 0; q < 2; ++q) logit += cue.bends[q] * std::max(0.f, cues[k] - cue.knots[q]);
  }
  return std::clamp(logit, -kLargestLogit, kLargestLogit);
}

}  // namespace

float shareContradicted(const cv::Mat& evidence, const cv::Mat1f& error) {
  constexpr float kClear = 2;           // a step of this multiple of its noise is the flow's fault
  constexpr float kMostlyShown = 0.5f;  // share of a window
  int shown = 0, contradicted = 0;
  for (int j = 0; j < evidence.rows; ++j)
    for (int i = 0; i < evidence.cols; ++i) {
      const float* cue = evidence.ptr<float>(j) + static_cast<std::ptrdiff_t>(i) * kCues;
      const float predicted = error(SplineGrid::kSpacing * j, SplineGrid::kSpacing * i);
      if (std::isinf(predicted) || cue[kHidden] >= kMostlyShown) continue;
      ++shown;
      contradicted += predicted > kHalf && cue[kWideStep] > cue[kWideNoise] + std::log(kClear);
    }
  return shown > 0 ? static_cast<float>(contradicted) / static_cast<float>(shown) : 0.f;
}

cv::Mat1f judgedError(const cv::Mat& evidence, FitKind kind, const cv::Mat1f& fit_error, int threads) {
  const FittedWeights& model = kFittedWeights[static_cast<int>(kind)];
  const float scale = kHalf * std::sqrt(kRayleigh);
  cv::Mat1f nodes(evidence.size());
  forRows(nodes.rows, threads, [&](int begin, int end) {
    for (int j = begin; j < end; ++j)
      for (int i = 0; i < nodes.cols; ++i)
        // (e / 0.25 px)^2 = (e - 1) odds; the exponential is taken here, once for sixteen pixels.
        nodes(j, i) =
            scale * std::exp(0.5f * logitOf(evidence.ptr<float>(j) + static_cast<std::ptrdiff_t>(i) * kCues, model));
  });
  constexpr int kStep = SplineGrid::kSpacing;
  cv::Mat1f error(fit_error.size());
  forRows(error.rows, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      const int j = y / kStep, below = std::min(j + 1, nodes.rows - 1);
      const float fy = static_cast<float>(y % kStep) / kStep;
      for (int x = 0; x < error.cols; ++x) {
        const int i = x / kStep, right = std::min(i + 1, nodes.cols - 1);
        const float fx = static_cast<float>(x % kStep) / kStep;
        error(y, x) = std::isinf(fit_error(y, x)) ? std::numeric_limits<float>::infinity()
                                                  : (1 - fy) * ((1 - fx) * nodes(j, i) + fx * nodes(j, right)) +
                                                        fy * ((1 - fx) * nodes(below, i) + fx * nodes(below, right));
      }
    }
  });
  return error;
}

}  // namespace cortshift_flow
