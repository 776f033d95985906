// How probable it is that a vector is right, from what images and surfaces say of it. The weights of both models are
// written by script/fit_trust shift (src/trust/fitted_weights.hpp).
#pragma once

#include <array>
#include <opencv2/core.hpp>

#include "cortshift_tracking/trust/agreement.hpp"

namespace cortshift_tracking {

/// What a right vector is off by at most [m], within the plane of the projection and in height: what `confidence` is
/// the probability of.
constexpr double kRightWithin = 0.00025;

/// Evidence about one vector of a flow.
struct MatchEvidence {
  float flow_error = 0;   ///< the flow's own predicted error [m]
  float correlation = 0;  ///< this and the following: see Agreement
  float residual = 0;
  float hue = 0;
  float bend = 0;
  float aperture = 0;
};

constexpr int kMatchCues = 6;

/// The evidence as the model takes it, each a doubt: the more, the likelier the vector is wrong. In the order above;
/// natural logarithms but for 1 - correlation.
std::array<float, kMatchCues> cuesOf(const MatchEvidence& evidence);

/// @param flow_confidence 0...1 of computeFlow(), at one place; @param resolution of the grid [m]
MatchEvidence evidenceAt(int row, int column, float flow_confidence, const Agreement& agreement, double resolution);

/// Probability that the vector is right to 0.25 mm within the plane of the projection: a logistic model, piecewise
/// linear in each cue.
float probabilityOfMatch(const MatchEvidence& evidence);

/// The same for a whole flow: CV_32FC1 0...1.
/// @param flow_confidence CV_32FC1 0...1 of computeFlow()
cv::Mat probabilityOfMatch(const cv::Mat& flow_confidence, const Agreement& agreement, double resolution);

/// Evidence about the two heights that a vector leads from and to.
struct HeightEvidence {
  float roughness = 0;  ///< root mean square deviation of the change of height from its mean over the window [m]
  float deviation = 0;  ///< standard deviation of the change of height that the two surfaces expect [m]
};

/// Natural logarithm of the roughness, as the model takes it.
float cueOf(const HeightEvidence& evidence);

/// Probability that the change of height is right to 0.25 mm where the vector is right within the plane: that neither
/// something else lies at one end (a logistic model of roughness), nor an error as the surfaces expect exceeds 0.25 mm
/// (normal distribution).
float probabilityOfHeight(const HeightEvidence& evidence);

}  // namespace cortshift_tracking
