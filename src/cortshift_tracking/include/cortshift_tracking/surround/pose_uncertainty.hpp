// What the cameras' poses of two stages may be off by, as a rigid motion between the two surfaces.
#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

namespace cortshift_tracking {

using Vector6 = Eigen::Matrix<double, 6, 1>;  ///< (x, y, z [m], rotation about x, y, z [rad]) about some centre
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// One source of error of a camera's pose; each coordinate is independent.
struct PoseErrorSource {
  std::string source;         ///< for people: tracker, hand-eye
  std::string known_from;     ///< how it is known
  double translation_sd = 0;  ///< of each coordinate [m]
  double rotation_sd = 0;     ///< about each axis [rad]
  bool common = false;        ///< one error of both stages: it counts only where the camera has turned between them
};

constexpr const char* kTracker = "tracker";
constexpr const char* kTremble = "tremble of the tracker";  ///< the part of it that samples around an exposure show

/// One source of error of the depths that a stereo head measures: it moves what is seen along the optical axis. Two
/// cameras that say the same of it (source, known from) make one error in both stages.
struct DepthErrorSource {
  std::string source, known_from;
  double scale_sd = 0;      ///< relative, of every depth
  double disparity_sd = 0;  ///< of 1 / depth [1/m]: error of disparity over focal length times baseline
};

/// A camera, and what its pose and depths may be off by.
struct PlacedCamera {
  Eigen::Isometry3d T_pmr_camera = Eigen::Isometry3d::Identity();
  std::vector<PoseErrorSource> errors;
  std::vector<DepthErrorSource> depths{};
};

/// Small motion of a point: t + w x (point - centre).
Eigen::Vector3d motionAt(const Vector6& motion, const Eigen::Vector3d& centre, const Eigen::Vector3d& point);

/// Root mean square length of that motion where it has this covariance and no mean.
double sdAt(const Matrix6& covariance, const Eigen::Vector3d& centre, const Eigen::Vector3d& point);

/// The same motion and covariance about another centre.
Vector6 aboutCentre(const Vector6& motion, const Eigen::Vector3d& from, const Eigen::Vector3d& to);
Matrix6 aboutCentre(const Matrix6& covariance, const Eigen::Vector3d& from, const Eigen::Vector3d& to);

/// What configured standard deviations of a tracked pose leave beside a tremble that is measured and counted.
PoseErrorSource trackerBeside(const std::vector<PoseErrorSource>& errors, double translation_sd, double rotation_sd);

/// Covariance, about `centre` [pmr], of the motion between the two surfaces that `source` of both cameras makes up.
Matrix6 covarianceOf(const PoseErrorSource& source, const Eigen::Isometry3d& T_pmr_earlier,
                     const Eigen::Isometry3d& T_pmr_later, const Eigen::Vector3d& centre);

/// What one source contributes, of both cameras together.
struct PoseErrorShare {
  std::string source, known_from;
  Matrix6 covariance;
};

/// Sources of one name together: independent ones of either camera, common ones (those of the later camera) once.
/// Depths count as at the centre.
std::vector<PoseErrorShare> poseErrorShares(const PlacedCamera& earlier, const PlacedCamera& later,
                                            const Eigen::Vector3d& centre);

/// Of all sources together.
Matrix6 poseCovariance(const PlacedCamera& earlier, const PlacedCamera& later, const Eigen::Vector3d& centre);

}  // namespace cortshift_tracking
