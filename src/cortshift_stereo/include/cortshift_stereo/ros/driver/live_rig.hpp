// What stands around real cameras or recorded images: calibration and hand-eye from files, the pose from tf.
#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <memory>
#include <optional>

#include "cortshift_stereo/ros/driver/stereo_driver.hpp"
#include "cortshift_stereo/ros/pose_lookup.hpp"

namespace cortshift_stereo {

class AravisSource;

/// Publishes: /tf_static (microscope -> left_optical where hand_eye is given, left_optical -> right_optical),
///   /diagnostics with the status "cameras" (source aravis).
class LiveRig {
 public:
  /// @throws CalibrationError, std::invalid_argument
  LiveRig(const ros::NodeHandle& node, const ros::NodeHandle& private_node, const StereoDriverParameters& parameters);

  std::shared_ptr<StereoSource> source() const { return source_; }

  /// Pose of the microscope from tf at exactly this time; nothing where the tracker does not know it.
  std::optional<Eigen::Isometry3d> T_reference_microscope(Stamp time);

 private:
  void sendStaticTransforms(const StereoModel& model, const std::string& hand_eye);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);

  double pose_wait_;  // longest wait for the tracker's next sample [s]
  std::shared_ptr<StereoSource> source_;
  std::shared_ptr<AravisSource> cameras_;  // source_, where it is one
  PoseLookup poses_;
  tf2_ros::StaticTransformBroadcaster static_broadcaster_;
  int jumps_told_[2] = {0, 0};  // of each camera's clock
  diagnostic_updater::Updater updater_;
  ros::WallTimer diagnostics_timer_;
};

}  // namespace cortshift_stereo
