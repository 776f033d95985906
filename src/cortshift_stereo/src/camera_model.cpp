#include "cortshift_stereo/camera_model.hpp"

#include <cmath>

namespace cortshift_stereo {
namespace {

std::string describe(const cv::Size& size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

void validateCamera(const CameraModel& camera, const std::string& side) {
  if (camera.size.width <= 0 || camera.size.height <= 0)
    throw CalibrationError(side + " camera_info: image size is " + describe(camera.size) + "; calibrate again");
  for (const double focal : {camera.K(0, 0), camera.K(1, 1), camera.P(0, 0), camera.P(1, 1)})
    if (!std::isfinite(focal) || focal <= 0)
      throw CalibrationError(side + " camera_info: a focal length in K or P is " + std::to_string(focal) +
                             " px; the camera is not calibrated");
  constexpr double kRotationTolerance = 1e-3;
  const cv::Matx33d gap = camera.R * camera.R.t() - cv::Matx33d::eye();
  if (!(cv::norm(gap) < kRotationTolerance) || !(cv::determinant(camera.R) > 0))
    throw CalibrationError(side + " camera_info: R is not a rotation (|R R' - 1| = " + std::to_string(cv::norm(gap)) +
                           ", det = " + std::to_string(cv::determinant(camera.R)) + "); calibrate again");
}

}  // namespace

void StereoModel::validate() const {
  validateCamera(left, "left");
  validateCamera(right, "right");
  if (left.size != right.size)
    throw CalibrationError("camera_info: left images are " + describe(left.size) + ", right ones " +
                           describe(right.size) + "; both cameras must have one size");
  constexpr double kFocalTolerance = 1e-6;
  if (std::abs(left.P(0, 0) - right.P(0, 0)) > kFocalTolerance * left.P(0, 0) ||
      std::abs(left.P(1, 1) - right.P(1, 1)) > kFocalTolerance * left.P(1, 1) ||
      std::abs(left.P(1, 2) - right.P(1, 2)) > kFocalTolerance * left.P(1, 1))
    throw CalibrationError("camera_info: left and right P differ in fx, fy or cy; they are not of one rectified pair");
  constexpr double kLongestBaseline = 1.0;  // [m]
  if (!(baseline() > 0) || baseline() > kLongestBaseline)
    throw CalibrationError("camera_info: the baseline -P[3]/fx of the right camera is " + std::to_string(baseline()) +
                           " m; it must be positive and below 1 m (are left and right swapped, or is P[3] missing?)");
}

}  // namespace cortshift_stereo
