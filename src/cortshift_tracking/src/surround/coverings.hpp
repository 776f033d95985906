// What lies on the brain.
#pragma once

#include <opencv2/core.hpp>

#include "surround/cells.hpp"

namespace cortshift_tracking {

/// CV_8UC1 255 on parts that stand out of the largest one by a step of depth, as instruments do.
cv::Mat standingOut(const Cells& cells, const Parts& parts);

/// CV_8UC1 255 on what lies on the brain and has no blood in it, as cotton: its colour, the light's share taken off, is
/// plainly nearer to that of the bone around than to the brain's, it has an edge, and is neither small nor narrow.
/// Nothing where brain and bone have one colour.
/// @param opening CV_8UC1 of the brain and what lies flat on it, where nothing is seen too
/// @param bone CV_8UC1 of the bone around it
cv::Mat bloodlessIn(const Cells& cells, const cv::Mat& opening, const cv::Mat& bone);

}  // namespace cortshift_tracking
