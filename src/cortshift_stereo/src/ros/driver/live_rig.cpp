#include "cortshift_stereo/ros/driver/live_rig.hpp"

#include <geometry_msgs/TransformStamped.h>

#include <algorithm>
#include <opencv2/core/affine.hpp>
#include <opencv2/core/eigen.hpp>

#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/calibration/hand_eye/hand_eye_yaml.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "sources/aravis/aravis_source.hpp"
#include "sources/folder_source.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kDiagnosticsPeriod = 1.0;  // [s]
constexpr double kShareOfPeriod = 0.5;      // waiting for a pose must not hold the next pair up

/// Pose of the raw right camera in the raw left one: both look along the same rectified axes, a baseline apart.
Eigen::Isometry3d T_left_right(const StereoModel& model) {
  Eigen::Matrix3d R_rectified_left, R_rectified_right;
  cv::cv2eigen(cv::Mat(model.left.R), R_rectified_left);
  cv::cv2eigen(cv::Mat(model.right.R), R_rectified_right);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R_rectified_left.transpose() * R_rectified_right;
  T.translation() = R_rectified_left.transpose() * Eigen::Vector3d(model.baseline(), 0, 0);
  return T;
}

Eigen::Isometry3d isometryFrom(const cv::Affine3d& affine) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  cv::cv2eigen(cv::Mat(affine.matrix), T.matrix());
  return T;
}

geometry_msgs::TransformStamped edge(const std::string& parent, const std::string& child, const Eigen::Isometry3d& T) {
  geometry_msgs::TransformStamped message;
  message.header.frame_id = parent;
  message.header.stamp = ros::Time::now();
  message.child_frame_id = child;
  message.transform = toTransform(T);
  return message;
}

}  // namespace

LiveRig::LiveRig(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                 const StereoDriverParameters& parameters)
    : pose_wait_(parameters.rate > 0 ? std::min(parameters.live.max_pose_gap, kShareOfPeriod / parameters.rate)
                                     : parameters.live.max_pose_gap),
      poses_(parameters.live.max_pose_gap),
      updater_(node, private_node, private_node.getNamespace()) {
  const LiveParameters& live = parameters.live;
  const StereoModel model = readStereoModelYaml(live.calibration_left, live.calibration_right);
  if (parameters.source == "aravis")
    source_ = cameras_ = std::make_shared<AravisSource>(live.aravis, model);
  else
    source_ = std::make_shared<FolderSource>(live.folder, live.loop, model, rosNow, live.image_bits);
  sendStaticTransforms(model, live.hand_eye);
  if (!cameras_) return;
  updater_.setHardwareID(live.aravis.left.device + " " + live.aravis.right.device);
  updater_.add("cameras", this, &LiveRig::diagnose);
  diagnostics_timer_ = node.createWallTimer(ros::WallDuration(kDiagnosticsPeriod),
                                            [this](const ros::WallTimerEvent&) { updater_.force_update(); });
}

std::optional<Eigen::Isometry3d> LiveRig::T_reference_microscope(Stamp time) {
  try {
    return poses_.lookup("reference", "microscope", toRosTime(time), ros::WallDuration(pose_wait_));
  } catch (const PoseError& error) {
    ROS_WARN_STREAM_THROTTLE(5, "no microscope pose is published with the pair: " << error.what());
    return std::nullopt;
  }
}

void LiveRig::sendStaticTransforms(const StereoModel& model, const std::string& hand_eye) {
  std::vector<geometry_msgs::TransformStamped> edges{edge("left_optical", "right_optical", T_left_right(model))};
  if (!hand_eye.empty()) edges.push_back(edge("microscope", "left_optical", isometryFrom(readHandEyeYaml(hand_eye))));
  static_broadcaster_.sendTransform(edges);
}

void LiveRig::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  status.summary(DiagnosticStatus::OK, "both cameras are connected");
  const CameraState states[2] = {cameras_->leftState(), cameras_->rightState()};
  for (int side = 0; side < 2; ++side) {
    const CameraState& state = states[side];
    const std::string name = side == 0 ? "left " : "right ";
    if (!state.connected)
      status.mergeSummary(DiagnosticStatus::ERROR, state.fault.empty() ? name + "camera: connecting" : state.fault);
    if (state.clock_jumps > 0) {
      const std::string told = Finding{CheckId::kDeviceClock, Verdict::kWarn, "The clock of the " + name + "camera",
                                       "was set by " + std::to_string(state.last_clock_jump) +
                                           " s, so that the stamps of its images began anew",
                                       "check who sets it (PTP, a reset); images around it may have no partner"}
                                   .sentence();
      status.mergeSummary(DiagnosticStatus::WARN, told);
      if (state.clock_jumps > jumps_told_[side]) ROS_WARN_STREAM(told);
      jumps_told_[side] = state.clock_jumps;
    }
    status.add(name + "clock jumps", state.clock_jumps);
    status.add(name + "connections", state.connections);
    status.add(name + "images", state.frames);
    status.add(name + "incomplete images", state.incomplete);
    status.add(name + "clock drift [ppm]", 1e6 * state.clock_drift);
    status.add(name + "exposure [s]", state.exposure);
    status.add(name + "gain", state.gain);
  }
  const AravisCounts counts = cameras_->counts();
  status.add("pairs", counts.pairs);
  status.add("pairs too late", counts.late);
  status.add("pairs incomplete", counts.incomplete);
  status.add("images mismatched", counts.mismatched);
  status.add("right exposure after left [ms]", 1000 * counts.last_gap);
}

}  // namespace cortshift_stereo
