// tf messages to a TransformTree, and the tree as a source of poses.
#pragma once

#include <ros/time.h>
#include <tf2_msgs/TFMessage.h>

#include <functional>
#include <string>

#include "cortshift_stereo/geometry/transform_tree.hpp"

namespace cortshift_stereo {

/// T_target_source at a stamp. @throws PoseError naming the edge or frame and the reason
using PoseAt =
    std::function<Eigen::Isometry3d(const std::string& target, const std::string& source, const ros::Time& stamp)>;

/// Frames may be spelt with or without a leading slash.
std::string withoutSlash(const std::string& frame);

/// @param fixed  the message is of /tf_static
/// @param when   it came; zero: not known
void addTransforms(TransformTree& tree, const tf2_msgs::TFMessage& message, bool fixed,
                   const ros::Time& when = ros::Time());

/// @throws PoseError
Eigen::Isometry3d poseFrom(const TransformTree& tree, const std::string& target, const std::string& source,
                           const ros::Time& stamp);

}  // namespace cortshift_stereo
