#include "cortshift_stereo/ros/driver/stereo_driver.hpp"

#include <cortshift_msgs/MicroscopeSettings.h>
#include <cv_bridge/cv_bridge.h>
#include <geometry_msgs/PoseStamped.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo/ros/shifted_time.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kDiagnosticsPeriod = 1.0;  // [s]
const char* const kSides[2] = {"left", "right"};

std_msgs::Header headerOf(const std::string& frame, const ros::Time& stamp) {
  std_msgs::Header header;
  header.frame_id = frame;
  header.stamp = stamp;
  return header;
}

}  // namespace

StereoDriver::StereoDriver(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                           const StereoDriverParameters& parameters, std::shared_ptr<StereoSource> source,
                           PoseAt pose_at)
    : parameters_(parameters),
      source_(std::move(source)),
      pose_at_(std::move(pose_at)),
      calibration_(source_->calibration()),
      last_diagnosis_(ros::Time::now()),
      updater_(node, private_node, private_node.getNamespace()) {
  calibration_.validate();
  ros::NodeHandle public_node(node), own_node(private_node);
  constexpr int kQueue = 4;
  for (int i = 0; i < 2; ++i) {
    const std::string prefix = std::string("stereo/") + kSides[i];
    images_[i] = public_node.advertise<sensor_msgs::Image>(prefix + "/image_raw", kQueue);
    infos_[i] = public_node.advertise<sensor_msgs::CameraInfo>(prefix + "/camera_info", kQueue);
  }
  pose_ = public_node.advertise<geometry_msgs::PoseStamped>("microscope/pose", kQueue);
  settings_ = public_node.advertise<cortshift_msgs::MicroscopeSettings>("microscope/settings", 1, true);
  publishSettings();
  updater_.setHardwareID(parameters_.source);
  updater_.add("pairs", this, &StereoDriver::diagnose);
  diagnostics_timer_ = public_node.createWallTimer(ros::WallDuration(kDiagnosticsPeriod),
                                                   [this](const ros::WallTimerEvent&) { updater_.force_update(); });
  trigger_ = own_node.advertiseService("trigger", &StereoDriver::trigger, this);
  if (parameters_.rate > 0)
    timer_ =
        public_node.createTimer(ros::Duration(1 / parameters_.rate), [this](const ros::TimerEvent&) { runFreely(); });
}

ros::Time StereoDriver::firePair() {
  const std::lock_guard<std::mutex> lock(fire_mutex_);
  try {
    publishSettings();
    const StereoPair pair = source_->fire();
    publishPair(pair);
    const std::lock_guard<std::mutex> status_lock(status_mutex_);
    ++published_;
    last_stamp_ = toRosTime(pair.stamp);
    last_refused_ = false;
    return last_stamp_;
  } catch (const SourceError& error) {
    const std::lock_guard<std::mutex> status_lock(status_mutex_);
    ++refused_;
    last_refusal_ = error.what();
    last_refused_ = true;
    throw;
  }
}

void StereoDriver::publishPair(const StereoPair& pair) {
  const ros::Time stamp = toRosTime(pair.stamp);
  if (const auto T_reference_microscope = pose_at_(pair.stamp)) {
    geometry_msgs::PoseStamped pose;
    pose.header = headerOf("reference", stamp);
    pose.pose = toPose(*T_reference_microscope);
    pose_.publish(pose);
  }
  const cv::Mat* images[2] = {&pair.left, &pair.right};
  const CameraModel* cameras[2] = {&calibration_.left, &calibration_.right};
  for (int i = 0; i < 2; ++i) {
    const ros::Time own_stamp = i == 0 ? stamp : shifted(stamp, parameters_.fault_stamp_offset);
    if (!parameters_.fault_no_camera_info)
      infos_[i].publish(toCameraInfo(*cameras[i], headerOf("left_optical", own_stamp)));
    images_[i].publish(
        cv_bridge::CvImage(headerOf(std::string(kSides[i]) + "_optical", own_stamp), "bgr8", *images[i]).toImageMsg());
  }
}

void StereoDriver::publishSettings() {
  const auto now = source_->settings();
  if (!now) return;
  if (published_settings_ && published_settings_->magnification == now->magnification &&
      published_settings_->focal_length == now->focal_length)
    return;
  cortshift_msgs::MicroscopeSettings message;
  message.header = headerOf("microscope", ros::Time::now());
  message.magnification = now->magnification;
  message.focal_length = now->focal_length;
  settings_.publish(message);
  published_settings_ = now;
}

bool StereoDriver::trigger(cortshift_msgs::TriggerCapture::Request&,
                           cortshift_msgs::TriggerCapture::Response& response) {
  try {
    response.stamp = firePair();
    response.success = true;
    response.message = "one pair at " + std::to_string(response.stamp.toSec());
  } catch (const SourceError& error) {
    response.success = false;
    response.message = std::string("no pair was taken: ") + error.what();
    ROS_WARN_STREAM("trigger: " << response.message);
  }
  return true;
}

void StereoDriver::runFreely() {
  try {
    firePair();
  } catch (const SourceError& error) {
    ROS_INFO_STREAM_THROTTLE(5, "no pair is taken: " << error.what());
  }
}

void StereoDriver::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::lock_guard<std::mutex> lock(status_mutex_);
  const ros::Time now = ros::Time::now();
  const double elapsed = (now - last_diagnosis_).toSec();
  const double rate = elapsed > 0 ? static_cast<double>(published_ - published_before_) / elapsed : 0;
  published_before_ = published_;
  last_diagnosis_ = now;
  if (last_refused_)
    status.summary(DiagnosticStatus::WARN, last_refusal_);
  else if (parameters_.rate > 0 && published_ > 0 && (now - last_stamp_).toSec() > 2 / parameters_.rate + 1)
    status.summary(DiagnosticStatus::ERROR, "no pair since " + std::to_string((now - last_stamp_).toSec()) + " s");
  else
    status.summary(DiagnosticStatus::OK, parameters_.rate > 0 ? "free running" : "waiting for the trigger");
  status.add("source", parameters_.source);
  status.add("pairs published", published_);
  status.add("pairs refused", refused_);
  status.add("last refusal", last_refusal_);
  status.add("rate wanted [Hz]", parameters_.rate);
  status.add("rate [Hz]", rate);
  status.add("last stamp [s]", last_stamp_.toSec());
}

}  // namespace cortshift_stereo
