// Where the flow may be wrong, and by how much.
#pragma once

#include "polish.hpp"

namespace cortshift_flow {

/// Confidence 1 / (1 + (e / 0.25 px)^2) of a predicted error e.
float confidenceOf(float predicted_error);

cv::Mat1f predictConfidence(const Level& level, const FlowPlanes& flow, const FlowPlanes& backward_half,
                            const cv::Mat1b& visible, const PolishedFlow& polished, float mismatch, int threads);

}  // namespace cortshift_flow
