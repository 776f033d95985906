#include "cortshift_tracking/case/patient_registration.hpp"

#include <algorithm>
#include <cmath>

#include "cortshift_stereo/ros/pose_tree.hpp"
#include "cortshift_stereo/ros/shifted_time.hpp"
#include "cortshift_tracking/case/calibration_identity.hpp"
#include "cortshift_tracking/case/same_registration.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/field/summary.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kSettling = 0.5;  // [s] for every node to hear of a change

bool known(const geometry_msgs::Pose& pose) { return std::isfinite(pose.position.x); }

Eigen::Isometry3d isometryOf(const geometry_msgs::Pose& pose) {
  const geometry_msgs::Quaternion& q = pose.orientation;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
  T.translation() = Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z);
  return T;
}

std::optional<geometry_msgs::Pose> find(const tf2_msgs::TFMessage& message) {
  std::optional<geometry_msgs::Pose> found;
  for (const geometry_msgs::TransformStamped& edge : message.transforms) {
    if (cortshift_stereo::withoutSlash(edge.header.frame_id) != "pmr" ||
        cortshift_stereo::withoutSlash(edge.child_frame_id) != "reference")
      continue;
    found.emplace();
    found->position.x = edge.transform.translation.x;
    found->position.y = edge.transform.translation.y;
    found->position.z = edge.transform.translation.z;
    found->orientation = edge.transform.rotation;
  }
  return found;
}

}  // namespace

geometry_msgs::Pose unknownPose() {
  geometry_msgs::Pose pose;
  pose.position.x = pose.position.y = pose.position.z = kUnknown;
  pose.orientation.x = pose.orientation.y = pose.orientation.z = pose.orientation.w = kUnknown;
  return pose;
}

geometry_msgs::Pose registrationOf(const tf2_msgs::TFMessage& fixed) { return find(fixed).value_or(unknownPose()); }

bool sameRegistration(const geometry_msgs::Pose& a, const geometry_msgs::Pose& b) {
  if (!known(a) || !known(b)) return known(a) == known(b);
  return sameRegistration(isometryOf(a), isometryOf(b));
}

std::uint32_t epochOf(const cortshift_msgs::StageInfo& stage, const std::vector<cortshift_msgs::StageInfo>& earlier) {
  if (!known(stage.registration)) return 0;
  std::uint32_t newest = 0;
  for (const cortshift_msgs::StageInfo& other : earlier) {
    if (other.epoch > 0 && sameRegistration(other.registration, stage.registration) && sameCalibration(other, stage))
      return other.epoch;
    newest = std::max(newest, other.epoch);
  }
  return newest + 1;
}

void requireSettled(const ros::Time& stamp, const ros::Time& changed) {
  if (stamp < cortshift_stereo::shifted(changed, kSettling))
    throw TrackingError("the patient registration changed at " + std::to_string(changed.toSec()) +
                        ", while or after the pair at " + std::to_string(stamp.toSec()) +
                        " was taken; capture again now that it is settled");
}

bool RegistrationHistory::add(const tf2_msgs::TFMessage& message, const ros::Time& time) {
  const auto heard = find(message);
  if (!heard) return false;
  const bool another = newest_ && !sameRegistration(*newest_, *heard);
  if (another) changed_ = time;
  newest_ = heard;
  return another;
}

geometry_msgs::Pose RegistrationHistory::newest() const { return newest_.value_or(unknownPose()); }

}  // namespace cortshift_tracking
