// Where the flow may be wrong, and by how much.
#pragma once

#include "polish/polish.hpp"

namespace cortshift_flow {

/// Predicted error at each pixel of a level [px of the level], infinite where the mask excludes it, from what is known
/// to cause it: the images' noise and lack of texture, as far as smoothing does not compensate them; bends of the
/// flow, which smoothing flattens; extrapolation, which grows with the distance from what is visible; motion
/// boundaries; and images that do not match.
/// @param visible    CV_8UC1, 1 where a pixel has a match
/// @param curvature  expected second difference of the flow between nodes, as the polish had it [px]
/// @param suspect    mean mismatch of windows beyond which they are suspect [intensity, summed over the channels]
cv::Mat1f predictError(const Level& level, const FlowPlanes& flow, const cv::Mat1b& visible,
                       const PolishedFlow& polished, float curvature, float suspect, int threads);

/// Confidence at each pixel of the image from the predicted error at those of level `l`.
cv::Mat1f confidenceFromError(const cv::Mat1f& error, int l, cv::Size size, int threads);

}  // namespace cortshift_flow
