#include "cortshift_stereo/ros/pair_reconstruction.hpp"

#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "cortshift_stereo/point_transform.hpp"
#include "cortshift_stereo/ros/conversions.hpp"

namespace cortshift_stereo {
namespace {

std::string text(double value) {
  char out[32];
  std::snprintf(out, sizeof out, "%.4g", value);
  return out;
}

cv::Mat decode(const ImageMessage& image) {
  return image.raw ? bgrFromImage(*image.raw) : bgrFromImage(*image.compressed);
}

}  // namespace

bool sameCalibration(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b) {
  sensor_msgs::CameraInfo other = b;
  other.header = a.header;
  return a == other;
}

DropReason dropReason(const std::exception& error) {
  const std::string what = error.what();
  if (const auto* pair = dynamic_cast<const PairError*>(&error)) return {pair->reason(), what};
  if (dynamic_cast<const MessageError*>(&error)) return {"image", "A message cannot be used: " + what + "."};
  if (dynamic_cast<const CalibrationError*>(&error))
    return {"calibration", "The calibration is refused: " + what + "."};
  if (dynamic_cast<const PoseError*>(&error)) return {"pose", "The pose of the camera is not known: " + what + "."};
  return {"internal", "The pair could not be processed: " + what + "."};
}

void PairReconstruction::check(const PairMessages& pair) {
  prepareRectifier(pair);
  checkSettings(pair);
}

PairSurface PairReconstruction::operator()(const PairMessages& pair, const PoseAt& pose_at) {
  check(pair);
  PairSurface out;
  out.rectifier = rectifier_;
  out.result = reconstruct(decode(pair.left), decode(pair.right), *rectifier_, parameters_.reconstruction);
  const Eigen::Isometry3d T_map_left = pose_at(parameters_.map_frame, parameters_.camera_frame, pair.stamp);
  out.averaged = average(pair.stamp, T_map_left, out.result);
  out.surface_map = out.result.surface_left;
  out.surface_map.points = transformPoints(T_map_left, out.result.surface_left.points);
  return out;
}

std::size_t PairReconstruction::average(const ros::Time& stamp, const Eigen::Isometry3d& T_map_left,
                                        ReconstructionResult& result) {
  if (parameters_.average_pairs == 1) return 1;
  const auto another = [&](const PastFrame& past) {
    const Eigen::Isometry3d movement = past.T_map_left.inverse() * T_map_left;
    return past.stamp >= stamp || (stamp - past.stamp).toSec() > parameters_.average_window ||
           past.rectifier != rectifier_ || movement.translation().norm() > parameters_.average_max_translation ||
           Eigen::AngleAxisd(movement.linear()).angle() > parameters_.average_max_rotation;
  };
  past_.erase(std::remove_if(past_.begin(), past_.end(), another), past_.end());
  if (past_.size() >= static_cast<std::size_t>(parameters_.average_pairs)) past_.erase(past_.begin());
  past_.push_back(
      {stamp, T_map_left, rectifier_, {result.disparity, result.surface_left.colour, result.surface_left.confidence}});
  std::vector<Frame> frames;
  for (const PastFrame& past : past_) frames.push_back(past.frame);
  ReconstructionResult mean = averageFrames(frames, rectifier_->model());
  result.disparity = mean.disparity;
  result.surface_left = mean.surface_left;
  return frames.size();
}

void PairReconstruction::prepareRectifier(const PairMessages& pair) {
  const sensor_msgs::CameraInfoConstPtr &left = pair.left_info, &right = pair.right_info;
  if (!left || !right)
    throw PairError("camera_info", std::string("No camera_info of the ") + (left ? "right" : "left") +
                                       " camera has arrived: check that the driver or the bag publishes it.");
  if (rectifier_ && sameCalibration(*left, *left_info_) && sameCalibration(*right, *right_info_)) return;
  rectifier_ = nullptr;
  rectifier_ = std::make_shared<const Rectifier>(stereoModelFromInfo(*left, *right));
  left_info_ = left;
  right_info_ = right;
  calibrated_setting_ = parameters_.referenceSetting();
}

void PairReconstruction::checkSettings(const PairMessages& pair) {
  if (!pair.settings) return;  // absent means the reference setting
  const MicroscopeSetting now{pair.settings->magnification, pair.settings->focal_length};
  if (!calibrated_setting_) {
    ROS_WARN_STREAM("no reference setting is configured: magnification "
                    << now.magnification << " and focal length " << now.focal_length
                    << " m are taken for those that the calibration in camera_info was made at");
    calibrated_setting_ = now;
  }
  const auto same = [&](double value, double reference) {
    return std::abs(value - reference) <= parameters_.settings_tolerance * reference;
  };
  if (!same(now.magnification, calibrated_setting_->magnification) ||
      !same(now.focal_length, calibrated_setting_->focal_length))
    throw PairError("settings", "The microscope is at magnification " + text(now.magnification) + " and focal length " +
                                    text(now.focal_length) + " m, but the calibration is for magnification " +
                                    text(calibrated_setting_->magnification) + " and focal length " +
                                    text(calibrated_setting_->focal_length) +
                                    " m, and no calibration of other settings is loaded: return to that setting.");
}

}  // namespace cortshift_stereo
