// From a request to a stage on disk.
#pragma once

#include <cortshift_msgs/AveragePairs.h>
#include <cortshift_msgs/CaptureMeanStage.h>
#include <cortshift_msgs/CaptureStage.h>
#include <cortshift_msgs/TriggerCapture.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>

#include <functional>
#include <mutex>
#include <optional>
#include <string>

#include "cortshift_tracking/ros/tracker/activity.hpp"
#include "cortshift_tracking/ros/tracker/bounded_call.hpp"
#include "cortshift_tracking/ros/tracker/open_case.hpp"
#include "cortshift_tracking/ros/tracker/pair_history.hpp"
#include "cortshift_tracking/ros/tracker/placement.hpp"
#include "cortshift_tracking/ros/tracker/surface_feed.hpp"

namespace cortshift_tracking {

/// One capture at a time, since each may fire the trigger: while one is under way another is refused at once.
///
/// Parameters: capture_timeout [s], max_surface_age [s]
/// Services: ~capture_stage, ~capture_mean_stage. They wait, and need a queue of their own with two threads.
/// Calls: /stereo_driver/trigger, where there is one; /surface_reconstruction/average_pairs for means
class Capturing {
 public:
  /// @param data  node whose callbacks go on while a capture waits
  /// @param services  private node of the services
  Capturing(const ShiftTrackerParameters& parameters, OpenCase& open, Placement& placement, const SurfaceFeed& feed,
            const PairHistory& pairs, Activity& activity, ros::NodeHandle& data, ros::NodeHandle& services);

 private:
  bool onCapture(cortshift_msgs::CaptureStage::Request& request, cortshift_msgs::CaptureStage::Response& response);
  bool onCaptureMean(cortshift_msgs::CaptureMeanStage::Request& request,
                     cortshift_msgs::CaptureMeanStage::Response& response);

  /// Stores the surface of one pair, or the mean of several, and says so in the response.
  template <typename Response>
  void capture(const std::string& key, const std::string& note, unsigned int pairs, Response& response);

  /// @returns what is worth saying about the stage beside its size
  std::string store(const std::string& key, const std::string& note, unsigned int pairs, StageRecord& record);
  sensor_msgs::PointCloud2ConstPtr awaitSurface();
  sensor_msgs::PointCloud2ConstPtr awaitMean(unsigned int pairs, std::string& remarks,
                                             cortshift_msgs::SurfaceStatusConstPtr& status);

  /// Fires the driver. @returns stamp of the pair; nothing where there is no driver @throws TrackingError
  std::optional<ros::Time> fire(Deadline deadline);

  const double timeout_;  // [s]
  const ros::Duration max_surface_age_;
  const double latency_sd_;                                             // [s]
  const std::function<std::string(const std::string&)> configuration_;  // all parameters, with the reconstruction's
  OpenCase& case_;
  Placement& placement_;
  const SurfaceFeed& feed_;
  const PairHistory& pairs_;
  Activity& activity_;
  BoundedCall<cortshift_msgs::TriggerCapture> trigger_;
  BoundedCall<cortshift_msgs::AveragePairs> average_;

  std::mutex under_way_;  // held by the capture that is
  std::mutex key_mutex_;
  std::string key_under_way_;
  ros::ServiceServer capture_, capture_mean_;
};

}  // namespace cortshift_tracking
