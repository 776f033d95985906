// What a lens and a camera's gains do to the light of a pinhole.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo_phantom/phantom_case.hpp"

namespace cortshift_stereo_phantom {

/// Blur by depth.
/// @param light  CV_32FC3
/// @param depth  CV_32FC1 [m]; NaN: in focus
/// @param focus  depth of the focal plane [m]
/// @param blur_per_metre  standard deviation [px] for every metre from it
cv::Mat outOfFocus(const cv::Mat& light, const cv::Mat& depth, double focus, double blur_per_metre);

/// The camera's own blur and gains.
cv::Mat respond(const cv::Mat& light, const ResponseSettings& response);

}  // namespace cortshift_stereo_phantom
