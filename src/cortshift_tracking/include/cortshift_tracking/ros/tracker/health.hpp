// Diagnostics of what a case lives on and of what the node does.
#pragma once

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/wall_timer.h>

#include "cortshift_tracking/ros/tracker/activity.hpp"
#include "cortshift_tracking/ros/tracker/live_tracking.hpp"
#include "cortshift_tracking/ros/tracker/open_case.hpp"
#include "cortshift_tracking/ros/tracker/placement.hpp"
#include "cortshift_tracking/ros/tracker/surface_feed.hpp"

namespace cortshift_tracking {

/// Age of the newest pose of the camera in pmr, its speed and jitter. @param max_pose_gap  [s]
diagnostic_msgs::DiagnosticStatus poseStatus(const PoseWatch& watch, double max_pose_gap, double max_speed);

/// Space left where the stages go, number of stages and epochs, the last stage.
diagnostic_msgs::DiagnosticStatus caseStatus(const StageStore& store);

/// What is so now, whoever asked for it: gravity, exclusions, live mode. Values:
///   gravity ("x y z" in pmr, or "not known"), gravity_from, excluded_stages (keys, with commas between)
///   live ("on" or "off"), live_from (key), live_trouble
diagnostic_msgs::DiagnosticStatus stateStatus(const OpenCase& open, const LiveTracking::Report& live);

/// Publishes: /diagnostics [diagnostic_msgs/DiagnosticArray] each second: "shift_tracker: stages", ": surfaces",
///   ": pose", ": case", ": state"
/// Parameters: max_pose_gap [s], max_speed [m/s]
class Health {
 public:
  Health(const ShiftTrackerParameters& parameters, const OpenCase& open, const Placement& placement,
         const SurfaceFeed& feed, const Activity& activity, const LiveTracking& live, ros::NodeHandle& node);

 private:
  void publish() const;

  const double max_pose_gap_, max_speed_;
  const OpenCase& case_;
  const Placement& placement_;
  const SurfaceFeed& feed_;
  const Activity& activity_;
  const LiveTracking& live_;
  ros::Publisher publisher_;
  ros::WallTimer timer_;
};

}  // namespace cortshift_tracking
