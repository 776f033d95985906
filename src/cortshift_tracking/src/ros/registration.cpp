#include "cortshift_tracking/ros/registration.hpp"

#include <algorithm>
#include <cmath>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/summary.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kSameShift = 1e-6;  // [m]
constexpr double kSameTurn = 1e-6;   // [rad]
const ros::Duration kSettling(0.5);  // for every node to hear of a change

bool known(const geometry_msgs::Pose& pose) { return std::isfinite(pose.position.x); }

bool same(const Eigen::Vector3d& t_a, const Eigen::Quaterniond& q_a, const Eigen::Vector3d& t_b,
          const Eigen::Quaterniond& q_b) {
  return (t_a - t_b).norm() <= kSameShift && q_a.angularDistance(q_b) <= kSameTurn;
}

template <typename Vector>
Eigen::Vector3d vectorOf(const Vector& v) {
  return {v.x, v.y, v.z};
}

Eigen::Quaterniond quaternionOf(const geometry_msgs::Quaternion& q) { return {q.w, q.x, q.y, q.z}; }

}  // namespace

geometry_msgs::Pose registrationAt(const cortshift_stereo::PoseAt& pose_at, const ros::Time& stamp) {
  try {
    return cortshift_stereo::toPose(pose_at("pmr", "reference", stamp));
  } catch (const cortshift_stereo::PoseError&) {
    geometry_msgs::Pose unknown;
    unknown.position.x = unknown.position.y = unknown.position.z = kUnknown;
    unknown.orientation.x = unknown.orientation.y = unknown.orientation.z = unknown.orientation.w = kUnknown;
    return unknown;
  }
}

bool sameRegistration(const geometry_msgs::Pose& a, const geometry_msgs::Pose& b) {
  if (!known(a) || !known(b)) return known(a) == known(b);
  return same(vectorOf(a.position), quaternionOf(a.orientation), vectorOf(b.position), quaternionOf(b.orientation));
}

std::uint32_t epochOf(const geometry_msgs::Pose& registration, const std::vector<cortshift_msgs::StageInfo>& stages) {
  if (!known(registration)) return 0;
  std::uint32_t newest = 0;
  for (const cortshift_msgs::StageInfo& stage : stages) {
    if (stage.epoch > 0 && sameRegistration(stage.registration, registration)) return stage.epoch;
    newest = std::max(newest, stage.epoch);
  }
  return newest + 1;
}

void RegistrationWatch::add(const tf2_msgs::TFMessage& message) {
  for (const geometry_msgs::TransformStamped& edge : message.transforms) {
    if (cortshift_stereo::withoutSlash(edge.header.frame_id) != "pmr" ||
        cortshift_stereo::withoutSlash(edge.child_frame_id) != "reference")
      continue;
    const std::lock_guard<std::mutex> guard(mutex_);
    const geometry_msgs::Transform& now = edge.transform;
    if (registration_ && !same(vectorOf(registration_->translation), quaternionOf(registration_->rotation),
                               vectorOf(now.translation), quaternionOf(now.rotation))) {
      changed_ = ros::Time::now();
      ROS_WARN("the patient registration has changed: stages from now on belong to another epoch");
    }
    registration_ = now;
  }
}

void RegistrationWatch::requireSettled(const ros::Time& stamp) const {
  const std::lock_guard<std::mutex> guard(mutex_);
  if (!changed_.isZero() && stamp < changed_ + kSettling)
    throw TrackingError("the patient registration changed at " + std::to_string(changed_.toSec()) +
                        ", while or after the pair at " + std::to_string(stamp.toSec()) +
                        " was taken; capture again now that it is settled");
}

}  // namespace cortshift_tracking
