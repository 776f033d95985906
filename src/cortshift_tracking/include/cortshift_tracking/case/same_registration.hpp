// When two poses of the reference frame in pmr are one patient registration.
#pragma once

#include <Eigen/Geometry>

namespace cortshift_tracking {

/// A navigation system sends its registration again and again, in text or float: what differs by less than a micrometre
/// and a microradian is rounding. Both are T_pmr_reference [m].
inline bool sameRegistration(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  constexpr double kSameShift = 1e-6;  // [m]
  constexpr double kSameTurn = 1e-6;   // [rad]
  const Eigen::Isometry3d change = a.inverse() * b;
  return change.translation().norm() <= kSameShift && Eigen::AngleAxisd(change.linear()).angle() <= kSameTurn;
}

}  // namespace cortshift_tracking
