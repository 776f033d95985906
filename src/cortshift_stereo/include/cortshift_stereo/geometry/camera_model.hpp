// The calibrated stereo head: what a pair of sensor_msgs/CameraInfo says, without ROS.
#pragma once

#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace cortshift_stereo {

/// A calibration that cannot be right. The message names the value and the remedy.
class CalibrationError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// How a lens bends rays, as ROS's camera_info names it.
enum class LensModel {
  kPlumbBob,            ///< k1 k2 p1 p2 k3 (Ji et al. 2014, Eq. 1: k1 alone); none or shorter: the rest is 0
  kRationalPolynomial,  ///< k1 k2 p1 p2 k3 k4 k5 k6
  kEquidistant,         ///< k1 k2 k3 k4 of the angle to the optical axis (OpenCV's fisheye); all 0 is no pinhole
};

/// One camera: its lens and its rectification.
struct CameraModel {
  cv::Size size;                          ///< [px]
  cv::Matx33d K = cv::Matx33d::eye();     ///< raw intrinsics [px]
  LensModel lens = LensModel::kPlumbBob;  ///< what D means
  std::vector<double> D;                  ///< coefficients of the lens
  cv::Matx33d R = cv::Matx33d::eye();     ///< raw camera coordinates to rectified ones
  cv::Matx34d P = cv::Matx34d::zeros();   ///< rectified projection; P(0,3) = -fx * baseline for the right camera [px m]
};

/// Both cameras of the microscope.
struct StereoModel {
  CameraModel left;
  CameraModel right;

  /// Distance of the camera centres along the rectified x axis [m].
  double baseline() const { return -right.P(0, 3) / right.P(0, 0); }

  /// @throws CalibrationError if sizes differ, a rotation is not orthonormal, a focal length or the baseline is not
  ///         positive, or the rectified focal lengths differ.
  void validate() const;
};

/// Depth along the rectified z axis [m] of disparity d = x_left - x_right [px]. Verging cameras have two principal
/// points, so d = 0 is not infinity: z = f B / (d - (cx_left - cx_right)).
inline double depthOfDisparity(const StereoModel& model, double disparity) {
  return model.left.P(0, 0) * model.baseline() / (disparity - (model.left.P(0, 2) - model.right.P(0, 2)));
}

}  // namespace cortshift_stereo
