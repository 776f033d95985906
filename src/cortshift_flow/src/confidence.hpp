// Where the flow may be wrong, and by how much.
#pragma once

#include "polish.hpp"

namespace cortshift_flow {

/// Confidence 1 / (1 + (e / 0.25 px)^2) of a predicted error e.
float confidenceOf(float predicted_error);

/// Predicts the error from what is known to cause it: extrapolation, which grows with the distance from what is
/// visible; curvature of the flow, which the smoothness term bends; motion boundaries; and images that do not match.
/// @param visible   CV_8UC1, 1 where a pixel has a match
/// @param mismatch  mean mismatch of windows beyond which they are suspect [intensity, summed over the channels]
cv::Mat1f predictConfidence(const Level& level, const FlowPlanes& flow, const cv::Mat1b& visible,
                            const PolishedFlow& polished, float mismatch, int threads);

}  // namespace cortshift_flow
