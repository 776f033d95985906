// Rigid transforms as calibration needs them.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core/affine.hpp>
#include <optional>

namespace cortshift_stereo {

/// Quaternion x y z w; none if it is not of unit length.
inline std::optional<cv::Matx33d> rotationFromQuaternion(const cv::Vec4d& xyzw) {
  constexpr double kTolerance = 1e-3;
  if (!(std::abs(cv::norm(xyzw) - 1) <= kTolerance)) return std::nullopt;
  const Eigen::Matrix3d rotation =
      Eigen::Quaterniond(xyzw[3], xyzw[0], xyzw[1], xyzw[2]).normalized().toRotationMatrix();
  return cv::Matx33d(rotation(0, 0), rotation(0, 1), rotation(0, 2), rotation(1, 0), rotation(1, 1), rotation(1, 2),
                     rotation(2, 0), rotation(2, 1), rotation(2, 2));
}

/// Quaternion x y z w with w >= 0.
inline cv::Vec4d quaternionFromRotation(const cv::Matx33d& rotation) {
  Eigen::Matrix3d matrix;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) matrix(row, column) = rotation(row, column);
  const Eigen::Quaterniond q(matrix);
  const double sign = q.w() < 0 ? -1 : 1;
  return sign * cv::Vec4d(q.x(), q.y(), q.z(), q.w());
}

/// Rotation vector and translation to a transform.
inline cv::Affine3d transformFromVector(const Eigen::Ref<const Eigen::VectorXd>& six) {
  return {cv::Vec3d(six(0), six(1), six(2)), cv::Vec3d(six(3), six(4), six(5))};
}

}  // namespace cortshift_stereo
