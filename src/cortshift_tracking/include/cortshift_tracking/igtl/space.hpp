// The one place where OpenIGTLink's millimetres and anatomical axes meet our metres and `pmr`.
#pragma once

#include <Eigen/Geometry>
#include <stdexcept>
#include <string>

namespace cortshift_tracking::igt {

/// A matrix that is not a pose. The message says what is wrong with it.
class PoseError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Directions of x, y, z in the patient: right-anterior-superior or left-posterior-superior.
enum class Axes { kRas, kLps };

/// @throws std::invalid_argument unless `text` is "ras" or "lps".
Axes axesFromText(const std::string& text);

/// Converts between `pmr` and bodies in metres and the link's millimetres. Only `pmr` has anatomical axes: it is the
/// one frame whose coordinates change sign between RAS and LPS; tracked bodies keep their own axes.
class LinkSpace {
 public:
  LinkSpace(Axes pmr_axes, Axes link_axes);

  Axes linkAxes() const { return link_axes_; }

  /// @param matrix_mm  pose of `child` in `parent` as sent: p_parent = matrix * p_child, lengths in mm
  /// @return T_parent_child [m]; its rotation is the nearest one to the matrix's
  /// @throws PoseError if a number is not finite, the last row is not 0 0 0 1, or the 3 x 3 part differs from a
  ///         rotation by more than 1e-4 (0.03 mm at 300 mm).
  Eigen::Isometry3d poseFromLink(const Eigen::Matrix4d& matrix_mm, const std::string& parent,
                                 const std::string& child) const;
  Eigen::Matrix4d poseToLink(const Eigen::Isometry3d& T_parent_child, const std::string& parent,
                             const std::string& child) const;

  /// Point or displacement in pmr [m] to the link's axes [mm], and back.
  Eigen::Vector3d vectorToLink(const Eigen::Vector3d& vector_pmr) const;
  Eigen::Vector3d vectorFromLink(const Eigen::Vector3d& vector_mm) const;

 private:
  Eigen::Vector3d signsOf(const std::string& frame) const;

  Axes link_axes_;
  Eigen::Vector3d pmr_signs_;
};

}  // namespace cortshift_tracking::igt
