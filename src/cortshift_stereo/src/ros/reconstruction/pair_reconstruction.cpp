#include "cortshift_stereo/ros/reconstruction/pair_reconstruction.hpp"

#include <ros/console.h>

#include <optional>
#include <utility>

#include "cortshift_stereo/admission/pair_quality.hpp"
#include "cortshift_stereo/admission/rig_evidence.hpp"
#include "cortshift_stereo/geometry/point_transform.hpp"
#include "cortshift_stereo/ros/conversions.hpp"

namespace cortshift_stereo {
namespace {

cv::Mat decode(const ImageMessage& image) {
  return image.raw ? bgrFromImage(*image.raw) : bgrFromImage(*image.compressed);
}

std::shared_ptr<const SettingsFields> fieldsOf(const std::string& folder) {
  if (folder.empty()) return nullptr;
  return std::make_shared<const SettingsFields>(readSettingsFields(folder));
}

}  // namespace

void requireOneContent(const ImageMessage& image, const std::string& side) {
  if (!image.raw || !image.compressed) return;
  cv::Mat raw = bgrFromImage(*image.raw), compressed = bgrFromImage(*image.compressed);
  BitDepth().toEightBits(raw, compressed);
  checkSameImage(raw, compressed, side).requireAccepted();
}

bool sameCalibration(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b) {
  sensor_msgs::CameraInfo other = b;
  other.header = a.header;
  return a == other;
}

DropReason dropReason(const std::exception& error) {
  const std::string what = error.what();
  if (const auto* pair = dynamic_cast<const PairError*>(&error)) return {pair->reason(), what};
  if (dynamic_cast<const MessageError*>(&error)) return {"image", "A message cannot be used: " + what + "."};
  if (dynamic_cast<const ImageError*>(&error)) return {checkOf(CheckId::kBitDepth).word, "The pair has " + what + "."};
  if (dynamic_cast<const CalibrationError*>(&error))
    return {"calibration", "The calibration is refused: " + what + "."};
  if (const auto* pose = dynamic_cast<const PoseError*>(&error))
    return {checkOf(pose->reason() == PoseError::Reason::kTwoSources ? CheckId::kPoseSources : CheckId::kPose).word,
            "The pose of the camera is not known: " + what + "."};
  return {"internal", "The pair could not be processed: " + what + "."};
}

PairReconstruction::PairReconstruction(const SurfaceReconstructionParameters& parameters,
                                       std::shared_ptr<BitDepth> depth)
    : parameters_(parameters),
      depth_(depth ? std::move(depth) : std::make_shared<BitDepth>(parameters.image_bits)),
      rectifiers_(fieldsOf(parameters.settings_calibration), parameters.referenceSetting(),
                  parameters.settings_tolerance),
      recent_(parameters.average, static_cast<std::size_t>(parameters.average_pairs)) {}

std::optional<MicroscopeSetting> settingSaid(const PairMessages& pair) {
  if (!pair.settings) return std::nullopt;
  return MicroscopeSetting{pair.settings->magnification, pair.settings->focal_length};
}

std::shared_ptr<const Rectifier> PairReconstruction::rectifierFor(const PairMessages& pair) {
  calibrate(pair);
  std::optional<MicroscopeSetting> setting = settingSaid(pair);
  if (setting && !setting->possible()) setting.reset();  // judgeKnown has said what absent means
  if (setting && !rectifiers_.reference())
    ROS_WARN_STREAM("no reference setting is configured: "
                    << describe(*setting) << " is taken for the one of the calibration in camera_info");
  return rectifiers_.at(setting);
}

Findings PairReconstruction::judgeKnown(const PairMessages& pair) const {
  Findings found = checkStamp(static_cast<int64_t>(pair.stamp.toNSec()));
  found.add(checkSettingKnown(settingSaid(pair), !parameters_.settings_calibration.empty()));
  found.requireAccepted();
  return found;
}

Findings PairReconstruction::judgePose(const PairMessages& pair, const StereoModel& model,
                                       const PoseSource& poses) const {
  Findings found;
  try {
    found.add(checkStereoEdge(model, poses.at(parameters_.camera_frame, parameters_.right_camera_frame, pair.stamp)));
  } catch (const PoseError& error) {
    // tf need not say where the right camera is: camera_info does. What it says twice is refused.
    if (error.reason() == PoseError::Reason::kTwoSources) throw;
  }
  if (poses.judge) found.add(poses.judge(parameters_.map_frame, parameters_.camera_frame, pair.stamp));
  found.requireAccepted();
  return found;
}

Findings PairReconstruction::check(const PairMessages& pair, const PoseSource& poses) {
  Findings found = judgeKnown(pair);
  rectifierFor(pair);
  poses.at(parameters_.map_frame, parameters_.camera_frame, pair.stamp);
  found.add(judgePose(pair, *stereo_, poses));
  return found;
}

PairSurface PairReconstruction::operator()(const PairMessages& pair, const PoseSource& poses) {
  PairSurface out;
  Findings found = judgeKnown(pair);
  out.frame.rectifier = rectifierFor(pair);
  requireOneContent(pair.left, "left");
  requireOneContent(pair.right, "right");
  cv::Mat left = decode(pair.left), right = decode(pair.right);
  depth_->toEightBits(left, right);
  out.result = reconstruct(left, right, *out.frame.rectifier, parameters_.reconstruction);
  out.frame.stamp_ns = static_cast<std::int64_t>(pair.stamp.toNSec());
  out.frame.T_pmr_left = poses.at(parameters_.map_frame, parameters_.camera_frame, pair.stamp);
  found.add(judgePose(pair, *stereo_, poses));
  views_.add(out.frame.stamp_ns, out.frame.T_pmr_left, left, out.frame.rectifier).requireAccepted();
  out.warnings = found.warnings();
  addWarnings(out.warnings, out.result.warnings);
  out.frame.warnings = out.warnings;
  out.frame.frame = {out.result.disparity, out.result.surface_left.colour, out.result.surface_left.confidence};
  recent_.add(out.frame);
  out.averaged = recent_.size();
  Eigen::Isometry3d T_pmr_surface = out.frame.T_pmr_left;
  if (out.averaged > 1) {
    const ViewFrames::Mean mean = recent_.mean();
    out.result.disparity = mean.result.disparity;
    out.result.surface_left = mean.result.surface_left;
    out.warnings = mean.warnings;
    T_pmr_surface = mean.T_pmr_left;
  }
  out.surface_map = out.result.surface_left;
  out.surface_map.points = transformPoints(T_pmr_surface, out.result.surface_left.points);
  return out;
}

void PairReconstruction::remember(const PairMessages& pair, const PoseSource& poses) {
  const auto rectifier = rectifierFor(pair);
  cv::Mat left = decode(pair.left);
  depth_->toEightBits(left);
  views_.add(static_cast<std::int64_t>(pair.stamp.toNSec()),
             poses.at(parameters_.map_frame, parameters_.camera_frame, pair.stamp), left, rectifier);
}

void PairReconstruction::calibrate(const PairMessages& pair) {
  const sensor_msgs::CameraInfoConstPtr &left = pair.left_info, &right = pair.right_info;
  if (!left || !right)
    throw PairError(CheckId::kCameraInfo,
                    std::string("The camera_info of the ") + (left ? "right" : "left") + " camera", "has not arrived",
                    "check that the driver or the bag publishes it");
  if (left_info_ && sameCalibration(*left, *left_info_) && sameCalibration(*right, *right_info_)) return;
  left_info_ = right_info_ = nullptr;
  stereo_ = stereoModelFromInfo(*left, *right);
  rectifiers_.calibrate(*stereo_);
  left_info_ = left;
  right_info_ = right;
}

}  // namespace cortshift_stereo
