// What stands around the phantom: tracker, registration, calibration and the operator who goes to the next stage.
#pragma once

#include <cortshift_msgs/SetPhantomStage.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include <memory>
#include <mutex>
#include <optional>

#include "cortshift_stereo/ros/driver/stereo_driver.hpp"

namespace cortshift_stereo {

class PhantomSource;
class SimulatedTracker;

/// Publishes: /tf_static (pmr -> reference, microscope -> left_optical, left_optical -> right_optical), /tf at the
///   tracker's rate (reference -> microscope, reference -> probe_tip), /diagnostics with the status "phantom".
/// Services: ~set_stage.
class PhantomRig {
 public:
  /// @throws cortshift_stereo_phantom::PhantomCaseError
  PhantomRig(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
             const StereoDriverParameters& parameters);
  ~PhantomRig();

  PhantomRig(const PhantomRig&) = delete;
  PhantomRig& operator=(const PhantomRig&) = delete;

  std::shared_ptr<StereoSource> source() const;

  /// Renders the first stage, some seconds.
  void prepare();

  /// From now on ~set_stage is answered.
  void offerStages();

  /// Exact pose of the microscope; nothing where the tracker is off.
  std::optional<Eigen::Isometry3d> T_reference_microscope(Stamp time) const;

 private:
  void sendStaticTransforms();
  void track();
  bool setStage(cortshift_msgs::SetPhantomStage::Request& request, cortshift_msgs::SetPhantomStage::Response& response);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);

  StereoDriverParameters parameters_;
  ros::NodeHandle private_node_;
  std::shared_ptr<PhantomSource> source_;
  std::unique_ptr<SimulatedTracker> tracker_;
  std::mutex status_mutex_;
  std::uint64_t samples_ = 0, unseen_ = 0;
  bool seen_ = false;

  tf2_ros::StaticTransformBroadcaster static_broadcaster_;
  tf2_ros::TransformBroadcaster broadcaster_;
  ros::ServiceServer set_stage_;
  diagnostic_updater::Updater updater_;
  ros::Timer timer_;
  ros::WallTimer diagnostics_timer_;
};

}  // namespace cortshift_stereo
