#include "cortshift_tracking/ros/stage_shift.hpp"

#include <cmath>

#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_stereo/calibration/settings/settings_warp.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/case/calibration_identity.hpp"
#include "cortshift_tracking/case/patient_registration.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

using cortshift_stereo::surfaceFromPointCloud2;

namespace {

/// [m]; nothing where the stage does not hold both camera_infos or they do not say.
std::optional<double> baselineOf(const StageRecord& stage) {
  if (!stage.left_info || !stage.right_info) return std::nullopt;
  const auto& P = stage.right_info->P;
  const double baseline = -P[3] / P[0];
  if (!std::isfinite(baseline) || baseline <= 0) return std::nullopt;
  return baseline;
}

std::string named(const cortshift_msgs::StageInfo& stage) {
  if (stage.key.empty()) return "now";
  return "'" + stage.key + "' (epoch " + std::to_string(stage.epoch) + ")";
}

}  // namespace

std::optional<std::string> changeBetween(const cortshift_msgs::StageInfo& earlier,
                                         const cortshift_msgs::StageInfo& later) {
  const std::string between = " changed between " + named(earlier) + " and " + named(later) +
                              ", so that their difference is no movement of the brain";
  // The numbers alone may mislead: an epoch was counted while a stage of another one could not be read.
  if (!sameRegistration(earlier.registration, later.registration)) return "the patient registration" + between;
  if (!sameCalibration(earlier, later))
    return "the calibration (camera_info, the hand-eye or the stereo edge)" + between;
  if (!later.key.empty() && earlier.epoch != later.epoch)
    return "the patient registration or the calibration" + between;
  return std::nullopt;
}

std::vector<std::string> warningsOf(const cortshift_msgs::StageInfo& from, const cortshift_msgs::StageInfo& to) {
  std::vector<std::string> warnings;
  for (const cortshift_msgs::StageInfo* stage : {&from, &to})
    for (const std::string& warning : stage->warnings)
      cortshift_stereo::addWarnings(warnings,
                                    {(stage->key.empty() ? "now" : "stage '" + stage->key + "'") + ": " + warning});
  return warnings;
}

PairKnowledge knowledgeOf(const StageRecord& from, const cortshift_msgs::StageInfo& to,
                          const SurroundSettings& settings, const std::vector<Region>& brain) {
  const auto camera = [&](const cortshift_msgs::StageInfo& stage) -> std::optional<PlacedCamera> {
    const geometry_msgs::Pose& pose = stage.camera_pose;
    // NaN, and the zeros of a message that nobody filled in, are no pose.
    if (!std::isfinite(pose.position.x) || !(std::abs(pose.orientation.w) + std::abs(pose.orientation.x) +
                                                 std::abs(pose.orientation.y) + std::abs(pose.orientation.z) >
                                             0))
      return std::nullopt;
    PlacedCamera placed{cortshift_stereo::isometryFromMessage(pose), {}, {}};
    for (const cortshift_msgs::PoseError& error : stage.pose_errors)
      placed.errors.push_back(
          {error.source, error.known_from, error.translation_sd, error.rotation_sd, error.common != 0});
    const cortshift_msgs::MicroscopeSettings& now = stage.settings;
    if (settings.zoom && settings.zoom->counts(now.magnification, now.focal_length))
      placed.depths.push_back({"zoom and focus",
                               "held-out residuals of their calibration, at " +
                                   cortshift_stereo::describe({now.magnification, now.focal_length}),
                               0, settings.zoom->disparity_sd});
    return placed;
  };
  PairKnowledge known{camera(from.info), camera(to), brain};
  if (const auto baseline = baselineOf(from)) known.baseline = *baseline;  // both stages are of one calibration
  return known;
}

std::vector<Region> Drawn::of(const std::map<std::string, std::vector<Region>>& regions, const std::string& key) {
  const auto found = regions.find(key);
  return found == regions.end() ? std::vector<Region>() : found->second;
}

Eigen::Vector3d FirstNormal::of(const StageStore& store) {
  const std::vector<cortshift_msgs::StageInfo> stages = store.list();
  if (stages.empty()) throw TrackingError("no stage has been captured yet; capture one first");
  const cortshift_msgs::StageInfo& first = stages.front();
  if (first.key != key_ || first.stamp != stamp_) {
    normal_ = averageNormal(surfaceFromPointCloud2(*store.load(first.key).surface));
    key_ = first.key;
    stamp_ = first.stamp;
  }
  return normal_;
}

StageShift computeStageShift(const StageStore& store, const std::string& from_key, const std::string& to_key,
                             FirstNormal& first_normal, const std::optional<Eigen::Vector3d>& gravity_pmr,
                             const ShiftSettings& settings, const Drawn& drawn, bool across_epochs) {
  if (to_key == kMrKey)
    throw TrackingError("the preoperative MR comes before every stage; give '" + to_key + "' as the earlier one");
  const std::size_t from = store.indexOf(from_key), to = store.indexOf(to_key);
  if (from == to) throw TrackingError("from and to are both stage '" + from_key + "'; give two different stages");
  if (from > to)
    throw TrackingError("stage '" + from_key + "' was captured after '" + to_key +
                        "'; the shift goes from an earlier to a later stage: swap the two");
  const StageRecord earlier = store.load(from_key), later = store.load(to_key);
  std::vector<std::string> warnings;
  if (const auto change = changeBetween(earlier.info, later.info)) {
    if (!across_epochs)
      throw TrackingError(*change + "; choose stages of one epoch, or ask for compute_shift_across_epochs");
    warnings.push_back(*change);
  }
  StageShift shift{earlier.info, later.info,
                   computeShift(surfaceFromPointCloud2(*earlier.surface), surfaceFromPointCloud2(*later.surface),
                                {first_normal.of(store), gravity_pmr}, settings, Drawn::of(drawn.excluded, from_key),
                                knowledgeOf(earlier, later.info, settings.surround, Drawn::of(drawn.brain, from_key)))};
  cortshift_stereo::addWarnings(warnings, warningsOf(earlier.info, later.info));
  cortshift_stereo::addWarnings(warnings, shift.result.summary.warnings);
  shift.result.summary.warnings = warnings;
  return shift;
}

}  // namespace cortshift_tracking
