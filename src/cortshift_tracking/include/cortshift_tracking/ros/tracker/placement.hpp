// Where the microscope is in pmr and whether that can be trusted: what a stage stands or falls with.
#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>

#include <string>
#include <vector>

#include "cortshift_stereo/ros/pose_lookup.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/ros/parameters.hpp"
#include "cortshift_tracking/ros/registration_watch.hpp"
#include "cortshift_tracking/ros/tracker/pose_watch.hpp"

namespace cortshift_tracking {

/// Parameters: max_pose_gap, max_speed, tracker_jitter.
/// Subscribes: /tf, /tf_static [tf2_msgs/TFMessage]
struct Placement {
  Placement(const ShiftTrackerParameters& parameters, ros::NodeHandle& node)
      : limits(parameters.poses),
        poses(parameters.max_pose_gap),
        watch(poses, parameters.max_speed),
        fixed(node.subscribe<tf2_msgs::TFMessage>(
            "/tf_static", 100, [this](const tf2_msgs::TFMessageConstPtr& message) { registration.add(*message); })) {}

  /// @returns what is accepted with a warning
  /// @throws TrackingError if the registration had just changed then, the microscope moved or was not seen, or its
  /// poses
  ///   are not to be trusted
  std::vector<std::string> requireTrustworthy(const ros::Time& stamp) {
    registration.requireSettled(stamp);
    watch.requireStill(stamp);
    try {
      const cortshift_stereo::Findings found = poses.judge("pmr", "left_optical", stamp, limits);
      if (const auto* finding = found.refusal()) throw TrackingError(finding->sentence());
      return found.warnings();
    } catch (const cortshift_stereo::PoseError& error) {
      if (error.reason() == cortshift_stereo::PoseError::Reason::kTwoSources) throw TrackingError(error.what());
      return {};  // not known: completing the stage says so
    }
  }

  const cortshift_stereo::PoseLimits limits;
  cortshift_stereo::PoseLookup poses;
  PoseWatch watch;
  RegistrationWatch registration;
  ros::Subscriber fixed;
};

}  // namespace cortshift_tracking
