// The keyed history of a case and the displacement between its stages, as services.
#pragma once

#include <cortshift_msgs/CaptureMeanStage.h>
#include <cortshift_msgs/CaptureStage.h>
#include <cortshift_msgs/ComputeShift.h>
#include <cortshift_msgs/DeleteStage.h>
#include <cortshift_msgs/ExcludeRegions.h>
#include <cortshift_msgs/ListStages.h>
#include <cortshift_msgs/SetGravity.h>
#include <cortshift_msgs/TrackShift.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/PointCloud2.h>

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "cortshift_stereo/ros/pose_lookup.hpp"
#include "cortshift_tracking/case/patient_registration.hpp"
#include "cortshift_tracking/case/stage_store.hpp"
#include "cortshift_tracking/ros/parameters.hpp"
#include "cortshift_tracking/ros/stage_shift.hpp"
#include "cortshift_tracking/ros/tracker/pair_history.hpp"
#include "cortshift_tracking/ros/tracker/pose_watch.hpp"
#include "cortshift_tracking/ros/tracker/surface_inbox.hpp"

namespace cortshift_tracking {

/// Parameters: see ShiftTrackerParameters.
///
/// Subscribes:
///   /surface/points [sensor_msgs/PointCloud2] organised surface in pmr
///   /diagnostics [diagnostic_msgs/DiagnosticArray] why the reconstruction dropped a pair
///   /tf, /tf_static, and what PairHistory needs
/// Publishes (latched):
///   /shift/field [cortshift_msgs/DisplacementField], /shift/points [sensor_msgs/PointCloud2]
///   /shift/markers [visualization_msgs/MarkerArray]
///   /shift/overlay_before, /shift/overlay_after, /shift/magnitude, /shift/gravity, /shift/normal, /shift/lateral
///   [sensor_msgs/Image] bgr8
///   /shift/own_points [sensor_msgs/PointCloud2] with own_points: displacements of the earlier surface's own points
///   /diagnostics
/// Services: ~capture_stage, ~capture_mean_stage, ~list_stages, ~delete_stage, ~compute_shift,
/// ~compute_shift_across_epochs, ~set_gravity, ~exclude_regions, ~track
/// Calls: /stereo_driver/trigger, where there is one; /surface_reconstruction/average_pairs for means
class ShiftTracker {
 public:
  /// @throws TrackingError if the case folder cannot be used
  ShiftTracker(const ShiftTrackerParameters& parameters, const ros::NodeHandle& private_node);
  ~ShiftTracker();

 private:
  struct Status;  // what diagnostics tell

  bool onCapture(cortshift_msgs::CaptureStage::Request& request, cortshift_msgs::CaptureStage::Response& response);
  bool onCaptureMean(cortshift_msgs::CaptureMeanStage::Request& request,
                     cortshift_msgs::CaptureMeanStage::Response& response);
  bool onList(cortshift_msgs::ListStages::Request& request, cortshift_msgs::ListStages::Response& response);
  bool onDelete(cortshift_msgs::DeleteStage::Request& request, cortshift_msgs::DeleteStage::Response& response);
  bool onCompute(cortshift_msgs::ComputeShift::Request& request, cortshift_msgs::ComputeShift::Response& response);
  bool onComputeAcrossEpochs(cortshift_msgs::ComputeShift::Request& request,
                             cortshift_msgs::ComputeShift::Response& response);
  bool compute(const cortshift_msgs::ComputeShift::Request& request, cortshift_msgs::ComputeShift::Response& response,
               bool across_epochs);
  bool onGravity(cortshift_msgs::SetGravity::Request& request, cortshift_msgs::SetGravity::Response& response);
  bool onExclude(cortshift_msgs::ExcludeRegions::Request& request, cortshift_msgs::ExcludeRegions::Response& response);
  bool onTrack(cortshift_msgs::TrackShift::Request& request, cortshift_msgs::TrackShift::Response& response);
  void onSurface(const sensor_msgs::PointCloud2ConstPtr& surface);
  void onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& message);
  void onTimer(const ros::WallTimerEvent& event);

  /// Stores the surface of one pair, or the mean of several, and says so in the response.
  template <typename Response>
  void capture(const std::string& key, const std::string& note, unsigned int pairs, Response& response);
  sensor_msgs::PointCloud2ConstPtr awaitSurface(const std::string& key);
  sensor_msgs::PointCloud2ConstPtr awaitMean(const std::string& key, unsigned int pairs, std::string& remarks);
  void requireTrustworthyPose(const std::string& key, const ros::Time& stamp) const;
  std::string whyNoSurface() const;
  Directions directions();
  void trackLoop(const std::string& key);
  void stopTracking();
  void publish(const ShiftResult& result, const cortshift_msgs::StageInfo& from, const cortshift_msgs::StageInfo& to,
               bool live);

  ShiftTrackerParameters parameters_;
  StageStore store_;
  cortshift_stereo::PoseLookup poses_;
  PoseWatch pose_watch_;
  RegistrationWatch registration_;
  SurfaceInbox inbox_;

  std::mutex capture_mutex_;  // one capture at a time: each may fire the trigger
  std::mutex compute_mutex_;  // of what follows, and of computing itself
  FirstNormal first_normal_;
  std::optional<Eigen::Vector3d> gravity_pmr_;
  std::map<std::string, std::vector<Region>> regions_;  // by key of the earlier stage

  std::mutex track_mutex_;  // of starting and stopping
  std::atomic<bool> tracking_{false};
  std::thread tracker_;

  mutable std::mutex status_mutex_;
  std::unique_ptr<Status> status_;

  ros::CallbackQueue data_queue_, service_queue_;
  ros::NodeHandle data_node_, service_node_;
  std::unique_ptr<PairHistory> pairs_;
  ros::Subscriber surfaces_, diagnostics_in_, fixed_;
  ros::Publisher field_, points_, markers_, overlay_before_, overlay_after_, magnitude_, gravity_, normal_, lateral_,
      own_points_, diagnostics_;
  ros::ServiceServer capture_, capture_mean_, list_, delete_, compute_, compute_across_epochs_, set_gravity_, exclude_,
      track_;
  ros::ServiceClient trigger_, average_;
  ros::WallTimer timer_;
  std::unique_ptr<ros::AsyncSpinner> data_spinner_, service_spinner_;
};

}  // namespace cortshift_tracking
