// The keyed history of a case and the displacement between its stages, as services.
#pragma once

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <ros/spinner.h>

#include "cortshift_tracking/ros/parameters.hpp"
#include "cortshift_tracking/ros/tracker/activity.hpp"
#include "cortshift_tracking/ros/tracker/capturing.hpp"
#include "cortshift_tracking/ros/tracker/case_services.hpp"
#include "cortshift_tracking/ros/tracker/field_publisher.hpp"
#include "cortshift_tracking/ros/tracker/health.hpp"
#include "cortshift_tracking/ros/tracker/live_tracking.hpp"
#include "cortshift_tracking/ros/tracker/open_case.hpp"
#include "cortshift_tracking/ros/tracker/pair_history.hpp"
#include "cortshift_tracking/ros/tracker/placement.hpp"
#include "cortshift_tracking/ros/tracker/shift_requests.hpp"
#include "cortshift_tracking/ros/tracker/surface_feed.hpp"

namespace cortshift_tracking {

/// The node: it makes the parts and gives each kind of request threads of its own, so that none waits for another's.
/// Parameters, topics and services stand with the parts.
class ShiftTracker {
 public:
  /// @throws TrackingError if the case folder cannot be used
  ShiftTracker(const ShiftTrackerParameters& parameters, const ros::NodeHandle& private_node);
  ~ShiftTracker();

 private:
  /// A queue with its own threads and the node that puts its callbacks there.
  struct Lane {
    Lane(const ros::NodeHandle& handle, unsigned int threads);
    ros::CallbackQueue queue;
    ros::NodeHandle node;
    ros::AsyncSpinner spinner;
  };

  Lane data_, captures_, computing_, questions_;
  OpenCase case_;
  Activity activity_;
  Placement placement_;
  SurfaceFeed feed_;
  PairHistory pairs_;
  FieldPublisher publisher_;
  Capturing capturing_;
  ShiftRequests shifts_;
  CaseServices services_;
  LiveTracking live_;
  Health health_;
};

}  // namespace cortshift_tracking
