#include "cortshift_stereo/geometry/camera_model.hpp"

#include <cmath>

#include "cortshift_stereo/geometry/lens.hpp"

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
  for (const double d : camera.D)
    if (!std::isfinite(d)) throw CalibrationError(side + " camera_info: D is not finite; calibrate again");
  checkedCoefficients(camera.lens, camera.D, side + " camera_info: D");
  for (const double c : {camera.K(0, 2), camera.K(1, 2), camera.P(0, 2), camera.P(1, 2)})
    if (!std::isfinite(c))
      throw CalibrationError(side + " camera_info: a principal point in K or P is not finite; calibrate again");
  const cv::Matx34d& P = camera.P;
  if (P(0, 1) != 0 || P(1, 0) != 0 || P(1, 3) != 0 || P(2, 0) != 0 || P(2, 1) != 0 || P(2, 2) != 1 || P(2, 3) != 0)
    throw CalibrationError(side + " camera_info: P is not [fx 0 cx Tx; 0 fy cy 0; 0 0 1 0], as of a horizontal pair");
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
  if (left.P(0, 3) != 0)
    throw CalibrationError("camera_info: P[3] of the left camera is " + std::to_string(left.P(0, 3)) +
                           ", but must be 0 (are left and right swapped?)");
  constexpr double kShortestBaseline = 0.001, kLongestBaseline = 1.0;  // [m]
  if (!(baseline() >= kShortestBaseline) || baseline() > kLongestBaseline)
    throw CalibrationError("camera_info: the baseline -P[3]/fx of the right camera is " + std::to_string(baseline()) +
                           " m; plausible is 0.001 ... 1 m (are left and right swapped, is P[3] missing, or is it not "
                           "in px m?)");
}

}  // namespace cortshift_stereo
