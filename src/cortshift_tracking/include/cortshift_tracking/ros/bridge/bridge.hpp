// OpenIGTLink on one side, the graph on the other.
#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include <mutex>
#include <optional>
#include <string>

#include "cortshift_tracking/igtl/endpoint.hpp"
#include "cortshift_tracking/igtl/tool_board.hpp"
#include "cortshift_tracking/ros/bridge/bridge_parameters.hpp"
#include "cortshift_tracking/ros/bridge/graph_sender.hpp"
#include "cortshift_tracking/ros/bridge/request_worker.hpp"

namespace cortshift_tracking::igt {

/// Publishes /tf (reference -> tools), /tf_static (pmr -> reference), /diagnostics. Takes TRANSFORM, TDATA, POSITION
/// and STATUS of the configured tools, requests as STRING (device `command_device`) or COMMAND, and GET_STATUS.
class Bridge {
 public:
  /// @throws std::runtime_error if the address cannot be listened on
  Bridge(ros::NodeHandle& node, const BridgeParameters& parameters);
  ~Bridge();
  Bridge(const Bridge&) = delete;
  Bridge& operator=(const Bridge&) = delete;

 private:
  EndpointHandlers handlers();
  void onMessage(PeerId peer, const Message& message);
  void publishPose(const TrackedPose& pose);
  void keepRegistration(const geometry_msgs::TransformStamped& registration) const;
  void restoreRegistration();
  void diagnoseConnections(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseTools(diagnostic_updater::DiagnosticStatusWrapper& status);

  BridgeParameters parameters_;
  LinkSpace space_;
  std::mutex board_mutex_;
  ToolBoard board_;
  std::optional<Eigen::Isometry3d> registration_;  // the endpoint's thread alone
  tf2_ros::TransformBroadcaster transforms_;
  tf2_ros::StaticTransformBroadcaster static_transforms_;
  std::uint64_t failures_told_ = 0;
  diagnostic_updater::Updater updater_;
  ros::Timer timer_;
  RequestWorker worker_;
  GraphSender sender_;
  Endpoint endpoint_;  // last: its thread uses all of the above
};

}  // namespace cortshift_tracking::igt
