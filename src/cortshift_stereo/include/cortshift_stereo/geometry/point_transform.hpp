// Moving whole surfaces from one frame to another.
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

namespace cortshift_stereo {

/// @param points_b  CV_32FC3 [m]; NaN stays NaN
/// @returns T_a_b * points_b
cv::Mat transformPoints(const Eigen::Isometry3d& T_a_b, const cv::Mat& points_b);

}  // namespace cortshift_stereo
