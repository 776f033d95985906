#include "cortshift_tracking/surround/pose_uncertainty.hpp"

#include <algorithm>
#include <cmath>

namespace cortshift_tracking {
namespace {

Eigen::Matrix3d cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// d(motion about `to`) / d(motion about `from`).
Matrix6 moved(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  Matrix6 j = Matrix6::Identity();
  j.topRightCorner<3, 3>() = -cross(to - from);
  return j;
}

/// d(motion about `centre`) / d(error of the pose, in the camera's axes).
Matrix6 leverOf(const Eigen::Isometry3d& T_pmr_camera, const Eigen::Vector3d& centre) {
  Matrix6 turned = Matrix6::Zero();
  turned.topLeftCorner<3, 3>() = turned.bottomRightCorner<3, 3>() = T_pmr_camera.linear();
  return moved(T_pmr_camera.translation(), centre) * turned;
}

/// Adds to the share of that name.
void add(std::vector<PoseErrorShare>& shares, const std::string& source, const std::string& known_from,
         const Matrix6& covariance) {
  const auto same = std::find_if(shares.begin(), shares.end(), [&](const PoseErrorShare& share) {
    return share.source == source && share.known_from == known_from;
  });
  if (same == shares.end())
    shares.push_back({source, known_from, covariance});
  else
    same->covariance += covariance;
}

bool holds(const PlacedCamera& camera, const DepthErrorSource& source) {
  return std::any_of(camera.depths.begin(), camera.depths.end(), [&](const DepthErrorSource& other) {
    return other.source == source.source && other.known_from == source.known_from;
  });
}

/// Where unit errors of the scale and of 1 / depth move what lies at the centre.
struct DepthLever {
  Eigen::Vector3d scale = Eigen::Vector3d::Zero(), disparity = Eigen::Vector3d::Zero();
};

DepthLever depthLever(const PlacedCamera& camera, const Eigen::Vector3d& centre) {
  const Eigen::Vector3d axis = camera.T_pmr_camera.linear().col(2);
  const double depth = (centre - camera.T_pmr_camera.translation()).dot(axis);
  return {depth * axis, depth * depth * axis};
}

Matrix6 covarianceOf(const DepthErrorSource& source, const DepthLever& lever) {
  const Eigen::Vector3d scale = source.scale_sd * lever.scale, disparity = source.disparity_sd * lever.disparity;
  Matrix6 covariance = Matrix6::Zero();
  covariance.topLeftCorner<3, 3>() = scale * scale.transpose() + disparity * disparity.transpose();
  return covariance;
}

}  // namespace

PoseErrorSource trackerBeside(const std::vector<PoseErrorSource>& errors, double translation_sd, double rotation_sd) {
  PoseErrorSource tracker{kTracker, "configured", translation_sd, rotation_sd, false};
  for (const PoseErrorSource& error : errors) {
    if (error.source != kTremble) continue;
    const auto rest = [](double all, double part) { return std::sqrt(std::max(0.0, all * all - part * part)); };
    tracker.known_from = "configured, without its tremble";
    tracker.translation_sd = rest(tracker.translation_sd, error.translation_sd);
    tracker.rotation_sd = rest(tracker.rotation_sd, error.rotation_sd);
  }
  return tracker;
}

Eigen::Vector3d motionAt(const Vector6& motion, const Eigen::Vector3d& centre, const Eigen::Vector3d& point) {
  return motion.head<3>() + motion.tail<3>().cross(point - centre);
}

double sdAt(const Matrix6& covariance, const Eigen::Vector3d& centre, const Eigen::Vector3d& point) {
  // E |t - [a] w|^2 = tr(tt) - 2 tr([a] wt) + a' (tr(ww) - ww) a, written out since it is asked of every vector.
  const Eigen::Vector3d arm = point - centre;
  const Eigen::Matrix3d wt = covariance.bottomLeftCorner<3, 3>(), ww = covariance.bottomRightCorner<3, 3>();
  const Eigen::Vector3d turned(wt(1, 2) - wt(2, 1), wt(2, 0) - wt(0, 2), wt(0, 1) - wt(1, 0));
  const double variance = covariance.topLeftCorner<3, 3>().trace() - 2 * arm.dot(turned) +
                          ww.trace() * arm.squaredNorm() - arm.dot(ww * arm);
  return std::sqrt(std::max(0.0, variance));
}

Vector6 aboutCentre(const Vector6& motion, const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  return moved(from, to) * motion;
}

Matrix6 aboutCentre(const Matrix6& covariance, const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Matrix6 j = moved(from, to);
  return j * covariance * j.transpose();
}

Matrix6 covarianceOf(const PoseErrorSource& source, const Eigen::Isometry3d& T_pmr_earlier,
                     const Eigen::Isometry3d& T_pmr_later, const Eigen::Vector3d& centre) {
  Vector6 sd;
  sd << Eigen::Vector3d::Constant(source.translation_sd), Eigen::Vector3d::Constant(source.rotation_sd);
  const Matrix6 each = sd.cwiseAbs2().asDiagonal();
  const Matrix6 first = leverOf(T_pmr_earlier, centre), second = leverOf(T_pmr_later, centre);
  if (source.common) return (second - first) * each * (second - first).transpose();
  return first * each * first.transpose() + second * each * second.transpose();
}

std::vector<PoseErrorShare> poseErrorShares(const PlacedCamera& earlier, const PlacedCamera& later,
                                            const Eigen::Vector3d& centre) {
  std::vector<PoseErrorShare> shares;
  for (const PlacedCamera* camera : {&earlier, &later})
    for (const PoseErrorSource& source : camera->errors) {
      if (source.common && camera == &earlier) continue;
      // An independent source belongs to one camera, so that half of what it makes of both is its own.
      const Matrix6 covariance =
          source.common ? covarianceOf(source, earlier.T_pmr_camera, later.T_pmr_camera, centre)
                        : Matrix6(covarianceOf(source, camera->T_pmr_camera, camera->T_pmr_camera, centre) / 2);
      add(shares, source.source, source.known_from, covariance);
    }
  const DepthLever first = depthLever(earlier, centre), second = depthLever(later, centre);
  for (const DepthErrorSource& source : earlier.depths)
    if (!holds(later, source)) add(shares, source.source, source.known_from, covarianceOf(source, first));
  for (const DepthErrorSource& source : later.depths) {
    const DepthLever between =
        holds(earlier, source) ? DepthLever{second.scale - first.scale, second.disparity - first.disparity} : second;
    add(shares, source.source, source.known_from, covarianceOf(source, between));
  }
  return shares;
}

Matrix6 poseCovariance(const PlacedCamera& earlier, const PlacedCamera& later, const Eigen::Vector3d& centre) {
  Matrix6 sum = Matrix6::Zero();
  for (const PoseErrorShare& share : poseErrorShares(earlier, later, centre)) sum += share.covariance;
  return sum;
}

}  // namespace cortshift_tracking
