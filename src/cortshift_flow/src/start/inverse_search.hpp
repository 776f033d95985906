// A second opinion on large motions: dense inverse search (Kroeger et al. 2016, OpenCV's DIS), whose overlapping
// patches follow a motion that varies strongly from place to place, where windows of whole-pixel matches lose it.
#pragma once

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

struct InverseSearch {
  FlowPlanes forward, backward;
};

/// Flow between the images of `fine`, both ways, on the grid of half its density, in that grid's pixels. Runs on
/// OpenCV's threads; their number, which belongs to the whole process, is not changed, nor seen in the result: DIS
/// divides its work into a fixed number of stripes (OpenCV 4.6; flow_threads_test).
/// @param size  of that grid
InverseSearch inverseSearch(const Level& fine, cv::Size size);

}  // namespace cortshift_flow
