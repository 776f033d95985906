// The integer part of the disparity: semi-global matching, and the range to search.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// Disparities x_left - x_right [px], from start (included) to end (excluded).
using SearchRange = cv::Range;

/// Semi-global matching (Hirschmueller 2008; OpenCV's three-path variant) with left-right check and speckle removal.
///
/// @param left, right  CV_8UC1, row-aligned, one size
/// @param range        any sign; its length is a multiple of 16
/// @returns CV_32FC1 of that size, NaN where there is no consistent match; fractions are OpenCV's, to 1/16 px
cv::Mat matchSemiGlobal(const cv::Mat& left, const cv::Mat& right, const SearchRange& range);

/// The same at the resolution that the scene asks for: a smooth surface is matched at half resolution, which costs an
/// eighth and leaves an error that refinement removes; a scene with many edges of depth at full resolution, with the
/// pixels beside the edges put on the surface that they belong to, or on none.
cv::Mat matchByStructure(const cv::Mat& left, const cv::Mat& right, const SearchRange& range);

/// Removes connected parts too small to trust, as matches between highlights are: 1/1000 of the image.
/// @param disparity  CV_32FC1 [px], NaN where invalid
void dropIslands(cv::Mat& disparity);

/// Disparities that a surface between the two working distances can have, for cameras with two principal points.
/// @param near, far  [m] along the rectified z axis, 0 < near < far
SearchRange possibleRange(const StereoModel& model, double near, double far);

/// The part of `possible` that the scene uses, from a match of reduced images. Its length is a multiple of 16. Empty
/// if the reduced images do not match.
/// @param left, right  CV_8UC1 rectified
/// @param relief       [m] depth on either side that the reduced images may have missed
SearchRange usedRange(const cv::Mat& left, const cv::Mat& right, const StereoModel& model, const SearchRange& possible,
                      double relief);

}  // namespace cortshift_stereo
