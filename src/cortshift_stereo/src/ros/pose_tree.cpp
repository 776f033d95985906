#include "cortshift_stereo/ros/pose_tree.hpp"

#include "cortshift_stereo/ros/pose_source.hpp"

namespace cortshift_stereo {

std::string withoutSlash(const std::string& frame) {
  return !frame.empty() && frame[0] == '/' ? frame.substr(1) : frame;
}

void addTransforms(TransformTree& tree, const tf2_msgs::TFMessage& message, bool fixed, const ros::Time& when) {
  const auto since = when.isZero() ? std::nullopt : std::make_optional(when.toSec());
  for (const geometry_msgs::TransformStamped& edge : message.transforms) {
    const geometry_msgs::Vector3& t = edge.transform.translation;
    const geometry_msgs::Quaternion& q = edge.transform.rotation;
    const std::string parent = withoutSlash(edge.header.frame_id);
    const std::string child = withoutSlash(edge.child_frame_id);
    if (fixed)
      tree.addFixed(parent, child, {t.x, t.y, t.z}, {q.w, q.x, q.y, q.z}, since);
    else
      tree.addSample(parent, child, static_cast<int64_t>(edge.header.stamp.toNSec()), {t.x, t.y, t.z},
                     {q.w, q.x, q.y, q.z});
  }
}

Eigen::Isometry3d poseFrom(const TransformTree& tree, const std::string& target, const std::string& source,
                           const ros::Time& stamp) {
  return tree.lookup(withoutSlash(target), withoutSlash(source), static_cast<int64_t>(stamp.toNSec()));
}

Findings judgePoses(const TransformTree& tree, const std::string& target, const std::string& source,
                    const ros::Time& stamp, const PoseLimits& limits) {
  return checkPoses(tree, withoutSlash(target), withoutSlash(source), static_cast<int64_t>(stamp.toNSec()), limits);
}

std::optional<ExposureMotion> poseMotion(const TransformTree& tree, const std::string& target,
                                         const std::string& source, const ros::Time& stamp) {
  return exposureMotion(tree, withoutSlash(target), withoutSlash(source), static_cast<int64_t>(stamp.toNSec()));
}

}  // namespace cortshift_stereo
