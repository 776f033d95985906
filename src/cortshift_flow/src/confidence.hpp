// Where the flow may be wrong, and by how much.
#pragma once

#include "polish.hpp"

namespace cortshift_flow {

/// Confidence 1 / (1 + (e / 0.25 px)^2) of a predicted error e.
float confidenceOf(float predicted_error);

/// Predicts the error from what is known to cause it: the images' noise and lack of texture, as far as smoothing does
/// not make up for them; bends of the flow, which smoothing flattens; extrapolation, which grows with the distance from
/// what is visible; motion boundaries; and images that do not match.
/// @param visible    CV_8UC1, 1 where a pixel has a match
/// @param curvature  expected second difference of the flow between nodes, as the polish had it [px]
/// @param suspect    mean mismatch of windows beyond which they are suspect [intensity, summed over the channels]
cv::Mat1f predictConfidence(const Level& level, const FlowPlanes& flow, const cv::Mat1b& visible,
                            const PolishedFlow& polished, float curvature, float suspect, int threads);

}  // namespace cortshift_flow
