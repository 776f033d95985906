// The shift from a stage to every new surface.
#pragma once

#include <cortshift_msgs/TrackShift.h>
#include <ros/node_handle.h>
#include <ros/service_server.h>

#include <atomic>
#include <mutex>
#include <string>
#include <thread>

#include "cortshift_tracking/ros/tracker/activity.hpp"
#include "cortshift_tracking/ros/tracker/field_publisher.hpp"
#include "cortshift_tracking/ros/tracker/open_case.hpp"
#include "cortshift_tracking/ros/tracker/pair_history.hpp"
#include "cortshift_tracking/ros/tracker/placement.hpp"
#include "cortshift_tracking/ros/tracker/surface_feed.hpp"

namespace cortshift_tracking {

/// Newest surface first, each from the field before. It follows what is excluded from its stage, and ends by itself
/// when that stage is deleted: another one of the same key is another one. It goes on where the node is started again.
///
/// Parameters: track_resolution [m], those of ShiftSettings
/// Services: ~track
class LiveTracking {
 public:
  LiveTracking(const ShiftTrackerParameters& parameters, OpenCase& open, Placement& placement, const SurfaceFeed& feed,
               const PairHistory& pairs, FieldPublisher& publisher, Activity& activity, ros::NodeHandle& services);
  ~LiveTracking();

  struct Report {
    bool on = false;
    std::string from;     ///< key of the stage; empty: off
    std::string trouble;  ///< why there is no field, or why it ended by itself; empty: nothing is wrong
  };
  Report report() const;

 private:
  bool onTrack(cortshift_msgs::TrackShift::Request& request, cortshift_msgs::TrackShift::Response& response);
  void stop();
  void begin(const cortshift_msgs::StageInfo& from);
  void goOn();
  void run(const cortshift_msgs::StageInfo& from);
  cortshift_msgs::StageInfo stateAt(const ros::Time& stamp) const;
  void say(bool on, const std::string& from, const std::string& trouble);

  ShiftSettings settings_;
  OpenCase& case_;
  Placement& placement_;
  const SurfaceFeed& feed_;
  const PairHistory& pairs_;
  FieldPublisher& publisher_;
  Activity& activity_;

  std::mutex switch_mutex_;  // of starting and stopping
  std::atomic<bool> wanted_{false};
  std::thread thread_;
  mutable std::mutex report_mutex_;
  Report report_;
  ros::ServiceServer track_;
};

}  // namespace cortshift_tracking
