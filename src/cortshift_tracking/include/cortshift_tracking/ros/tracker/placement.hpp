// Where the microscope is in pmr and whether that can be trusted: what a stage stands or falls with.
#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>

#include "cortshift_stereo/ros/pose_lookup.hpp"
#include "cortshift_tracking/case/patient_registration.hpp"
#include "cortshift_tracking/ros/parameters.hpp"
#include "cortshift_tracking/ros/tracker/pose_watch.hpp"

namespace cortshift_tracking {

/// Parameters: max_pose_gap, max_speed.
/// Subscribes: /tf, /tf_static [tf2_msgs/TFMessage]
struct Placement {
  Placement(const ShiftTrackerParameters& parameters, ros::NodeHandle& node)
      : poses(parameters.max_pose_gap),
        watch(poses, parameters.max_speed),
        fixed(node.subscribe<tf2_msgs::TFMessage>(
            "/tf_static", 100, [this](const tf2_msgs::TFMessageConstPtr& message) { registration.add(*message); })) {}

  /// @throws TrackingError if the registration had just changed then, or the microscope moved or was not seen
  void requireTrustworthy(const ros::Time& stamp) const {
    registration.requireSettled(stamp);
    watch.requireStill(stamp);
  }

  cortshift_stereo::PoseLookup poses;
  PoseWatch watch;
  RegistrationWatch registration;
  ros::Subscriber fixed;
};

}  // namespace cortshift_tracking
