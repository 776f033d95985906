// Surfaces and disparities as files that other programs read.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "cortshift_stereo/geometry/surface.hpp"

namespace cortshift_stereo {

/// Binary PLY of the valid points: x y z [m] as float, red green blue as uchar, confidence as float.
/// @throws std::runtime_error if the file cannot be written
void writePly(const std::string& path, const Surface& surface);

/// PFM, NaN where invalid. @param disparity  CV_32FC1 [px]
/// @throws std::runtime_error if the file cannot be written
void writePfm(const std::string& path, const cv::Mat& disparity);

}  // namespace cortshift_stereo
