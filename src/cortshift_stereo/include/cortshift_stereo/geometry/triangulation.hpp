// Disparity to points (Ji et al. 2014, section 2.2).
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// @param disparity  CV_32FC1 of the rectified left image [px], NaN where invalid
/// @returns CV_32FC3 [m] in the raw left camera frame (rotated back by the transpose of the rectifying rotation);
///          NaN where the disparity is, or where it belongs to a point behind the cameras
cv::Mat triangulate(const cv::Mat& disparity, const StereoModel& model);

}  // namespace cortshift_stereo
