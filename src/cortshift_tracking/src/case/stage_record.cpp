#include "cortshift_tracking/case/stage_record.hpp"

#include "cortshift_stereo/provenance.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo/ros/pose_tree.hpp"
#include "cortshift_tracking/case/calibration_identity.hpp"
#include "cortshift_tracking/case/patient_registration.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/field/summary.hpp"
#include "cortshift_tracking/projection/projection_frame.hpp"
#include "cortshift_tracking/surround/pose_uncertainty.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_stereo::PoseSource;
using cortshift_stereo::PoseSpread;

cortshift_msgs::PoseError errorOf(const char* source, const char* known_from, const PoseSpread& spread, double factor) {
  cortshift_msgs::PoseError error;
  error.source = source;
  error.known_from = known_from;
  error.translation_sd = factor * spread.translation;
  error.rotation_sd = factor * spread.rotation;
  error.common = 0;
  return error;
}

/// What is stored already stays where the samples are not known.
void addPoseErrors(cortshift_msgs::StageInfo& info, const PoseSource& poses, double latency_sd) {
  if (!poses.motion) return;
  const auto motion = poses.motion("pmr", "left_optical", info.stamp);
  if (!motion) return;
  info.pose_errors = {
      errorOf(kTremble, "measured around the exposure", motion->tremble, 1),
      errorOf("latency of the tracker", "configured, times the speed around the exposure", motion->speed, latency_sd)};
}

void addTransforms(StageRecord& record, const PoseSource& poses, double latency_sd, std::string& remarks) {
  const ros::Time& stamp = record.info.stamp;
  try {
    record.info.camera_pose = cortshift_stereo::toPose(poses.at("pmr", "left_optical", stamp));
    addPoseErrors(record.info, poses, latency_sd);
  } catch (const std::exception& error) {
    record.info.camera_pose = unknownPose();
    remarks += std::string("; camera pose not known: ") + error.what();
    record.info.warnings.push_back(std::string("The pose of the camera is not known: ") + error.what() + ".");
    return;
  }
  const auto edge = [&](const char* parent, const char* child) {
    geometry_msgs::TransformStamped transform;
    transform.header.stamp = stamp;
    transform.header.frame_id = parent;
    transform.child_frame_id = child;
    transform.transform = cortshift_stereo::toTransform(poses.at(parent, child, stamp));
    return transform;
  };
  try {
    record.tf_static.transforms = {edge("pmr", "reference"), edge("microscope", "left_optical")};
    record.tf.transforms = {edge("reference", "microscope")};
    record.tf_static.transforms.push_back(edge("left_optical", "right_optical"));
  } catch (const cortshift_stereo::PoseError&) {  // a tree without those frames in between
    if (!record.tf.transforms.empty()) return;    // only the right camera is not in it
    record.tf_static.transforms.clear();
    record.tf.transforms = {edge("pmr", "left_optical")};
  }
}

}  // namespace

std::string placeRecord(StageRecord& record, const PoseSource& poses, double latency_sd) {
  std::string remarks;
  addTransforms(record, poses, latency_sd, remarks);
  record.info.registration = registrationOf(record.tf_static);
  record.info.provenance.software = cortshift_stereo::softwareVersion();
  record.info.provenance.configuration = record.parameters.empty() ? "" : cortshift_stereo::sha256(record.parameters);
  record.info.provenance.calibration = calibrationOf(record);
  return remarks;
}

std::string completeStage(StageRecord& record, const PoseSource& poses, double latency_sd) {
  const std::string frame = cortshift_stereo::withoutSlash(record.surface->header.frame_id);
  if (frame != "pmr")
    throw TrackingError(
        "the surface is in the frame '" + frame +
        "', not pmr; a case is of one patient's pmr: leave surface_reconstruction's map_frame as it is");
  const cortshift_stereo::Surface surface = cortshift_stereo::surfaceFromPointCloud2(*record.surface);
  averageNormal(surface);  // a surface that no shift can be computed from is refused now
  record.info.valid_points = 0;
  for (auto it = surface.points.begin<cv::Vec3f>(); it != surface.points.end<cv::Vec3f>(); ++it)
    if ((*it)[0] == (*it)[0]) ++record.info.valid_points;
  record.info.coverage = record.info.valid_points / static_cast<double>(surface.points.total());
  std::string remarks;
  const bool has_pair = (record.left && record.right) || (record.left_compressed && record.right_compressed);
  if (!has_pair) remarks += "; without its raw pair, which was not seen";
  if (record.settings) {
    record.info.settings = *record.settings;
  } else {
    record.info.settings.header.stamp = record.info.stamp;
    record.info.settings.magnification = record.info.settings.focal_length = kUnknown;
  }
  return remarks + placeRecord(record, poses, latency_sd);
}

}  // namespace cortshift_tracking
