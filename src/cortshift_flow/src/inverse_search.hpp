// A second opinion on large motions: dense inverse search (Kroeger et al. 2016, OpenCV's DIS), whose overlapping
// patches follow a motion that varies strongly from place to place, where windows of whole-pixel matches lose it.
#pragma once

#include "coarse_to_fine.hpp"

namespace cortshift_flow {

/// Flow between the images of `fine` (first to second) on the grid of half its density, in that grid's pixels.
/// @param size  of that grid
FlowPlanes inverseSearch(const Level& fine, cv::Size size);

/// Takes `other` in place of `flow` where windows then mismatch clearly less.
void adoptWhereBetter(const Level& level, const FlowPlanes& other, FlowPlanes& flow, int threads);

}  // namespace cortshift_flow
