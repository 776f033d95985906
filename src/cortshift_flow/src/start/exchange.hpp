// Large corrections that no linearisation finds: pixels try the flow of their surroundings.
#pragma once

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// Where windows mismatch by more than `mismatch` per pixel, each pixel tries the flow found `reach` pixels away in
/// eight directions, as it is and extrapolated linearly, and takes it where a window about the pixel then matches
/// clearly better. So a motion found in the middle of a moving region spreads to its boundary.
/// @param mismatch  [intensity, 0...1, summed over the channels]
/// @param fixed  1 where the flow is to stay as it is (CV_8UC1), or empty
void exchangeFlow(const Level& level, const std::vector<int>& reaches, int window, float mismatch,
                  const cv::Mat1b& fixed, FlowPlanes& flow, int threads);

}  // namespace cortshift_flow
