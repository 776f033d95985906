// What a stage shows, in cells of a few grid points.
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

/// CV_32FC3: logarithms of colours. In the dark there is no colour.
cv::Mat logarithmOf(const cv::Mat& colour);

}  // namespace cortshift_tracking
