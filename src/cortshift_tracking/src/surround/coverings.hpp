// What a stage shows, in cells of 0.2 mm, and what lies on the brain in it.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_tracking/projection/projection.hpp"

namespace cortshift_tracking {

/// Means over cells.
struct Cells {
  int step = 1;
  double side = 0;  ///< [m]
  cv::Mat colour;   ///< CV_32FC3 0...1
  cv::Mat height;   ///< CV_32FC1 [m], NaN where nothing is seen
  cv::Mat seen;     ///< CV_8UC1
};

/// @param side [m] of a cell, to the nearest whole number of grid points
Cells cellsOf(const Projection& projection, double side);

/// What hangs together without a step of depth.
struct Parts {
  cv::Mat labels;  ///< CV_32SC1, 0: none
  cv::Mat areas;   ///< CV_32SC1 [cells], by label
  int largest = 0;
};

Parts partsOf(const Cells& cells);

/// CV_8UC1 255 on parts that stand out of the largest one by a step of depth, as instruments do.
cv::Mat standingOut(const Cells& cells, const Parts& parts);

/// CV_8UC1 255 on what lies on the brain and has no blood in it, as cotton: its colour, the light's share taken off, is
/// nearer to that of the bone around than to the brain's. Nothing where brain and bone have one colour.
/// @param opening CV_8UC1 of the brain and what lies flat on it, where nothing is seen too
/// @param bone CV_8UC1 of the bone around it
cv::Mat bloodlessIn(const Cells& cells, const cv::Mat& opening, const cv::Mat& bone);

}  // namespace cortshift_tracking
