#include "cortshift_tracking/trust/probability.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "cortshift_flow/flow.hpp"
#include "parallel.hpp"
#include "trust/fitted_weights.hpp"

namespace cortshift_tracking {
namespace {

constexpr float kLeast = 1e-9F;  // of what a logarithm is taken: below any length or brightness that is measured

float logOf(float value) { return std::log(std::max(value, kLeast)); }  // what is no number stays none

static_assert(std::size(kMatchWeights) == kMatchCues, "the weights are of other cues: fit them anew");

/// What a cue adds to the logit that the vector is wrong. Beyond the outer knots lies next to nothing of the fitting
/// set: nothing changes.
float added(float cue, const CueWeights& weights) {
  float sum = 0;
  for (int i = 0; i < kSlopes; ++i)
    sum += weights.slopes[i] * (std::clamp(cue, weights.knots[i], weights.knots[i + 1]) - weights.knots[i]);
  return sum;
}

float probabilityOfRight(float logit_of_wrong) { return 1 / (1 + std::exp(logit_of_wrong)); }

}  // namespace

std::array<float, kMatchCues> cuesOf(const MatchEvidence& evidence) {
  return {logOf(evidence.flow_error), 1 - evidence.correlation, logOf(evidence.residual),
          logOf(evidence.hue),        logOf(evidence.bend),     logOf(evidence.aperture)};
}

float cueOf(const HeightEvidence& evidence) { return logOf(evidence.roughness); }

MatchEvidence evidenceAt(int row, int column, float flow_confidence, const Agreement& agreement, double resolution) {
  return {static_cast<float>(cortshift_flow::predictedError(flow_confidence) * resolution),
          agreement.correlation.at<float>(row, column),
          agreement.residual.at<float>(row, column),
          agreement.hue.at<float>(row, column),
          agreement.bend.at<float>(row, column),
          agreement.aperture.at<float>(row, column)};
}

float probabilityOfMatch(const MatchEvidence& evidence) {
  if (!std::isfinite(evidence.flow_error)) return 0;  // there is no flow to judge
  const std::array<float, kMatchCues> cues = cuesOf(evidence);
  float logit = kMatchConstant;
  for (std::size_t i = 0; i < cues.size(); ++i) logit += added(cues[i], kMatchWeights[i]);
  return probabilityOfRight(logit);
}

cv::Mat probabilityOfMatch(const cv::Mat& flow_confidence, const Agreement& agreement, double resolution) {
  cv::Mat probability(flow_confidence.size(), CV_32FC1);
  parallelRanges(probability.rows, 0, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int column = 0; column < probability.cols; ++column)
        probability.at<float>(row, column) =
            probabilityOfMatch(evidenceAt(row, column, flow_confidence.at<float>(row, column), agreement, resolution));
  });
  return probability;
}

float probabilityOfHeight(const HeightEvidence& evidence) {
  const float deviation = kExpectedTooLittle * std::max(evidence.deviation, kLeast);
  return probabilityOfRight(kHeightConstant + added(cueOf(evidence), kRoughnessWeights)) *
         std::erf(static_cast<float>(kRightWithin) / (std::sqrt(2.0F) * deviation));
}

}  // namespace cortshift_tracking
