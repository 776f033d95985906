// Takes stereo pairs from a source and publishes them, free running or on request.
#pragma once

#include <cortshift_msgs/TriggerCapture.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "cortshift_stereo/ros/driver/live_parameters.hpp"
#include "cortshift_stereo/sources/stereo_source.hpp"

namespace cortshift_stereo {

inline ros::Time toRosTime(Stamp stamp) { return ros::Time().fromNSec(static_cast<std::uint64_t>(stamp.count())); }
inline Stamp rosNow() { return Stamp(static_cast<Stamp::rep>(ros::Time::now().toNSec())); }

/// Parameters of stereo_driver, each default once.
struct StereoDriverParameters {
  std::string source;         ///< which cameras: phantom, aravis or folder; must be given
  double rate = 4.0;          ///< pairs per second, free running; 0: only when triggered
  std::string phantom_case;   ///< path of the case (source phantom)
  std::string stage;          ///< first stage of the phantom; empty: the case's first
  double move_time = 1.0;     ///< of the phantom's microscope between two stages [s]
  double probe_dwell = 2.0;   ///< time that the phantom's probe rests on each target [s]
  double probe_travel = 1.0;  ///< and its way to the next [s]

  // Simulated tracker of the phantom.
  double tracker_rate = 20.0;           ///< samples per second
  double tracker_latency = 0.0;         ///< from sample to report [s]
  double tracker_jitter = 0.0;          ///< standard deviation of each coordinate [m]
  double tracker_jitter_angle = 0.0;    ///< standard deviation about each axis [rad]
  double probe_jitter = 0.0;            ///< of the probe's tip, besides [m]
  double tracker_dropouts = 0.0;        ///< mean number of dropouts per second
  double tracker_dropout_length = 0.2;  ///< [s]
  int tracker_seed = 1;

  // Faults, for tests of what comes behind.
  std::string fault_images = "none";  ///< none, blank, saturated or swapped
  double fault_stamp_offset = 0.0;    ///< of the right image against the left [s]
  bool fault_no_camera_info = false;  ///< camera_info is not published
  bool fault_no_tracker = false;      ///< no pose is published

  LiveParameters live;  ///< sources aravis and folder

  /// @throws ParameterError
  static StereoDriverParameters load(const ros::NodeHandle& private_node);
};

/// Parameters: StereoDriverParameters, as private parameters of the node.
/// Publishes: stereo/{left,right}/image_raw (bgr8, one stamp), stereo/{left,right}/camera_info with each pair (both in
///   left_optical), microscope/pose (microscope in reference, at each pair's stamp), microscope/settings (latched),
///   /diagnostics with the status "pairs".
/// Services: ~trigger (fires one pair and answers with its stamp).
class StereoDriver {
 public:
  /// Pose of the microscope in `reference` at a time; nothing where it is not known.
  using PoseAt = std::function<std::optional<Eigen::Isometry3d>(Stamp)>;

  StereoDriver(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
               const StereoDriverParameters& parameters, std::shared_ptr<StereoSource> source, PoseAt pose_at);

 private:
  ros::Time firePair();
  void publishPair(const StereoPair& pair);
  void publishSettings();
  bool trigger(cortshift_msgs::TriggerCapture::Request& request, cortshift_msgs::TriggerCapture::Response& response);
  void runFreely();
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);

  StereoDriverParameters parameters_;
  std::shared_ptr<StereoSource> source_;
  PoseAt pose_at_;
  StereoModel calibration_;

  std::mutex fire_mutex_;
  std::optional<OpticalSettings> published_settings_;

  std::mutex status_mutex_;
  std::uint64_t published_ = 0, published_before_ = 0, refused_ = 0;
  ros::Time last_stamp_, last_diagnosis_;
  std::string last_refusal_;
  bool last_refused_ = false;

  ros::Publisher images_[2], infos_[2], pose_, settings_;
  ros::ServiceServer trigger_;
  diagnostic_updater::Updater updater_;
  ros::Timer timer_;
  ros::WallTimer diagnostics_timer_;
};

/// Takes and publishes pairs of the source that the parameters name until the process is asked to end. See
/// StereoDriver, PhantomRig and LiveRig for parameters, topics and services.
/// @param private_node  the names of its parameters, services and diagnostics begin with this one's namespace
/// @throws ParameterError, CalibrationError, cortshift_stereo_phantom::PhantomCaseError, std::invalid_argument
void runStereoDriver(const ros::NodeHandle& node, const ros::NodeHandle& private_node);

}  // namespace cortshift_stereo
