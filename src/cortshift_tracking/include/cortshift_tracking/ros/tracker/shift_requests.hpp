// The shift between two stages, on request.
#pragma once

#include <cortshift_msgs/ComputeShift.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>

#include <functional>
#include <string>

#include "cortshift_tracking/ros/tracker/activity.hpp"
#include "cortshift_tracking/ros/tracker/field_publisher.hpp"
#include "cortshift_tracking/ros/tracker/open_case.hpp"
#include "cortshift_tracking/ros/tracker/surface_feed.hpp"

namespace cortshift_tracking {

/// Parameters: those of ShiftSettings
/// Services: ~compute_shift, ~compute_shift_across_epochs. They compute for seconds, one after the other, and need a
/// queue of their own.
class ShiftRequests {
 public:
  ShiftRequests(const ShiftTrackerParameters& parameters, OpenCase& open, const SurfaceFeed& feed,
                FieldPublisher& publisher, Activity& activity, ros::NodeHandle& services);

 private:
  bool compute(const cortshift_msgs::ComputeShift::Request& request, cortshift_msgs::ComputeShift::Response& response,
               bool across_epochs);

  const ShiftSettings settings_;
  const std::function<std::string()> configuration_;  // hash of all parameters in force
  OpenCase& case_;
  FieldPublisher& publisher_;
  Activity& activity_;
  ros::ServiceServer compute_, compute_across_epochs_;
};

}  // namespace cortshift_tracking
