#include "cortshift_tracking/offline/case_capture.hpp"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

#include "cortshift_stereo/admission/limits.hpp"
#include "cortshift_stereo/admission/rig_evidence.hpp"
#include "cortshift_stereo/geometry/point_transform.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo/ros/shifted_time.hpp"
#include "cortshift_tracking/case/patient_registration.hpp"
#include "cortshift_tracking/case/stage_record.hpp"
#include "cortshift_tracking/ros/tracker/pose_watch.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_stereo::PairMessages;
using cortshift_stereo::shifted;
using cortshift_stereo::SurfaceReconstructionParameters;

constexpr double kSlice = 1.0;  // [s] of recording that is looked through at one go

std::string seconds(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", value);
  return text;
}

/// When a pair was exposed in record time, which captures are asked in. The way to the disk is short: where stamp and
/// record differ by more, the stamp is of another clock.
ros::Time exposed(const PairPlace& place) {
  const bool one_clock =
      std::abs(place.arrival.toSec() - place.stamp.toSec()) <= cortshift_stereo::ClockLimits::kTransport;
  return one_clock ? place.stamp : place.arrival;
}

std::string refusal(const PlannedCapture& planned) { return "stage '" + planned.key + "' was not captured: "; }

StageRecord recordWith(const PairMessages& messages, const cortshift_stereo::Surface& surface_map,
                       const std::string& map_frame) {
  StageRecord record;
  std_msgs::Header header;
  header.stamp = messages.stamp;
  header.frame_id = map_frame;
  record.surface = boost::make_shared<sensor_msgs::PointCloud2>(toPointCloud2(surface_map, header));
  record.info.stamp = messages.stamp;
  record.left = messages.left.raw;
  record.right = messages.right.raw;
  record.left_compressed = messages.left.compressed;
  record.right_compressed = messages.right.compressed;
  record.left_info = messages.left_info;
  record.right_info = messages.right_info;
  record.settings = messages.settings;
  return record;
}

}  // namespace

PairMessages pairOf(const StageRecord& record) {
  return {record.info.stamp,
          {record.left, record.left_compressed},
          {record.right, record.right_compressed},
          record.left_info,
          record.right_info,
          record.settings};
}

SurfaceReconstructionParameters CaseCapture::parametersAt(const PairMessages& messages) const {
  SurfaceReconstructionParameters parameters = parameters_.reconstruction;
  if (!parameters.referenceSetting() && parameters.settings_calibration.empty())
    if (const auto reference = recording_.referenceSetting(messages)) {
      parameters.reference_magnification = reference->magnification;
      parameters.reference_focal_length = reference->focal_length;
    }
  return parameters;
}

StageRecord CaseCapture::recordOf(const PairPlace& place) const {
  const PairMessages messages = recording_.read(place);
  const SurfaceReconstructionParameters parameters = parametersAt(messages);
  cortshift_stereo::PairReconstruction reconstruct(parameters, depth_);
  const auto surfaceOf = [&](const PairPlace& pair, const PairMessages& content) {
    return reconstruct(content, recording_.posesAround(pair.arrival, parameters.max_pose_gap));
  };
  if (parameters.average_pairs > 1)
    for (const PairPlace& earlier :
         recording_.pairs(shifted(place.arrival, -parameters.average.age - kSlice), place.arrival)) {
      if (earlier.stamp >= place.stamp || (place.stamp - earlier.stamp).toSec() > parameters.average.age) continue;
      try {
        surfaceOf(earlier, recording_.read(earlier));
      } catch (const std::exception&) {
        continue;  // as in the node: a pair that gives no surface is no part of the mean
      }
    }
  rememberEarlier(place, reconstruct);
  const cortshift_stereo::PairSurface surface = surfaceOf(place, messages);
  StageRecord record = recordWith(messages, surface.surface_map, parameters.map_frame);
  record.info.warnings = surface.warnings;
  cortshift_stereo::addWarnings(record.info.warnings, recording_.judgeClock(place).warnings());
  return record;
}

void CaseCapture::rememberEarlier(const PairPlace& place, cortshift_stereo::PairReconstruction& reconstruct) const {
  constexpr double kPast = 60;      // [s] as the nodes remember
  constexpr std::size_t kMost = 8;  // images to decode of the same pose, and of others
  const double gap = parameters_.reconstruction.max_pose_gap;
  const auto poseOf = [&](const PairPlace& pair) -> std::optional<Eigen::Isometry3d> {
    try {
      return recording_.posesAround(pair.arrival, gap)
          .at(parameters_.reconstruction.map_frame, parameters_.reconstruction.camera_frame, pair.stamp);
    } catch (const cortshift_stereo::PoseError&) {
      return std::nullopt;
    }
  };
  const auto pose = poseOf(place);
  if (!pose) return;  // the reconstruction says why
  std::vector<PairPlace> same, others;
  for (const PairPlace& earlier : recording_.pairs(shifted(place.arrival, -kPast), place.arrival)) {
    if (earlier.stamp >= place.stamp) continue;
    if (const auto other = poseOf(earlier)) (other->matrix() == pose->matrix() ? same : others).push_back(earlier);
  }
  std::vector<PairPlace> chosen;
  for (const std::vector<PairPlace>* list : {&same, &others}) {
    const std::size_t step = std::max<std::size_t>(1, (list->size() + kMost - 1) / kMost);
    for (std::size_t i = 0; i < list->size(); i += step) chosen.push_back((*list)[i]);
  }
  std::sort(chosen.begin(), chosen.end(), [](const PairPlace& a, const PairPlace& b) { return a.stamp < b.stamp; });
  for (const PairPlace& earlier : chosen) try {
      reconstruct.remember(recording_.read(earlier), recording_.posesAround(earlier.arrival, gap));
    } catch (const std::exception&) {  // a pair that cannot be used says nothing
    }
}

StageRecord CaseCapture::capture(const PlannedCapture& planned, std::string& remarks) const {
  Captured captured = planned.pairs > 1 ? captureMean(planned) : captureOne(planned);
  const ros::Time asked = shifted(recording_.begin(), planned.seconds);
  try {
    StageRecord& record = captured.record;
    const cortshift_stereo::PoseSource poses =
        recording_.posesAround(captured.arrival, parameters_.tracker.max_pose_gap);
    if (const auto changed = recording_.registrationChanged(std::max(asked, captured.arrival)))
      requireSettled(record.info.stamp, *changed);
    if (const auto motion = motionAround(record.info.stamp, poses.at))
      requireSlow(*motion, parameters_.tracker.max_speed);
    record.info.key = planned.key;
    record.info.note = planned.note;
    record.parameters = parameters_.configuration();
    remarks = captured.remarks + completeStage(record, poses, parameters_.tracker.shift.surround.pose_latency_sd);
    return record;
  } catch (const std::exception& error) {
    throw TrackingError(refusal(planned) + error.what());
  }
}

CaseCapture::Captured CaseCapture::captureOne(const PlannedCapture& planned) const {
  const ros::Time asked = shifted(recording_.begin(), planned.seconds);
  const double length = recording_.end().toSec() - recording_.begin().toSec();
  const double max_age = parameters_.tracker.max_surface_age;
  std::size_t tried = 0;
  std::string why;
  Captured captured;
  const auto attempt = [&](const PairPlace& place) {
    ++tried;
    try {
      captured.record = recordOf(place);
      captured.arrival = place.arrival;
      cortshift_stereo::addWarnings(
          captured.record.info.warnings,
          cortshift_stereo::checkWait(exposed(place).toSec() - asked.toSec(), max_age).warnings());
      return true;
    } catch (const std::exception& error) {
      why = dropped(place, error);
      return false;
    }
  };
  const auto recent = [&](const PairPlace& place) { return asked.toSec() - exposed(place).toSec() <= max_age; };

  std::vector<PairPlace> before = recording_.pairs(shifted(asked, -max_age - kSlice), asked);
  for (auto place = before.rbegin(); place != before.rend(); ++place)
    if (recent(*place) && attempt(*place)) return captured;
  const double timeout = parameters_.tracker.capture_timeout;
  for (double from = 0; from < timeout; from += kSlice)
    for (const PairPlace& place :
         recording_.pairs(shifted(asked, from), shifted(asked, std::min(from + kSlice, timeout))))
      if (recent(place) && attempt(place)) return captured;
  throw TrackingError(refusal(planned) + "no pair from " + seconds(max_age) + " before to " + seconds(timeout) +
                      " after " + seconds(planned.seconds) + " of the bag's " + seconds(length) + " gives a surface, " +
                      std::to_string(tried) + " tried" + (tried == 0 ? whyNone(asked) : why));
}

std::string CaseCapture::whyNone(const ros::Time& asked) const {
  const auto unpaired = recording_.unpaired(shifted(asked, -parameters_.tracker.max_surface_age),
                                            shifted(asked, parameters_.tracker.capture_timeout));
  const std::string others = recording_.notUnderstood();
  return (unpaired.empty() ? ": no image of the two cameras is recorded there"
                           : ": " + std::to_string(unpaired.size()) +
                                 " images there have no partner. The first: " + unpaired.front()) +
         (others.empty() ? ""
                         : "; images that are recorded on other topics: " + others +
                               "; rename them to /stereo/{left,right}/image_raw");
}

CaseCapture::Captured CaseCapture::captureMean(const PlannedCapture& planned) const {
  const ros::Time asked = shifted(recording_.begin(), planned.seconds);
  const double patience = parameters_.tracker.capture_timeout;
  cortshift_stereo::ViewTolerance tolerance = parameters_.reconstruction.average;
  tolerance.age = std::numeric_limits<double>::infinity();  // patience says how long it may take
  cortshift_stereo::ViewFrames frames(tolerance, planned.pairs);
  std::optional<cortshift_stereo::PairReconstruction> reconstruct;
  std::size_t offered = 0;
  std::string why;
  std::vector<std::string> clocks;  // what is odd about them
  ros::Time heard = asked;          // of the last pair that gave a surface
  for (ros::Time from = asked; (from - heard).toSec() < patience; from = shifted(from, kSlice))
    for (const PairPlace& place : recording_.pairs(from, shifted(from, kSlice))) {
      if (exposed(place) < asked || (place.arrival - heard).toSec() > patience) continue;
      try {
        const PairMessages messages = recording_.read(place);
        if (!reconstruct) reconstruct.emplace(parametersAt(messages), depth_);
        const auto poses = recording_.posesAround(place.arrival, parameters_.reconstruction.max_pose_gap);
        frames.add((*reconstruct)(messages, poses).frame);
        ++offered;
        heard = place.arrival;
        cortshift_stereo::addWarnings(clocks, recording_.judgeClock(place).warnings());
        if (frames.size() < planned.pairs) continue;
        cortshift_stereo::ViewFrames::Mean mean = frames.mean();
        cortshift_stereo::Surface& surface = mean.result.surface_left;
        surface.points = cortshift_stereo::transformPoints(mean.T_pmr_left, surface.points);
        Captured captured{recordWith(messages, surface, parameters_.reconstruction.map_frame), place.arrival,
                          "; mean of " + std::to_string(frames.size()) + " pairs"};
        captured.record.info.warnings = mean.warnings;
        cortshift_stereo::addWarnings(captured.record.info.warnings, clocks);
        if (offered > frames.size())
          captured.remarks += "; " + std::to_string(offered - frames.size()) +
                              " more were left out, as the microscope or its setting had moved";
        return captured;
      } catch (const std::exception& error) {
        why = dropped(place, error);
      }
    }
  throw TrackingError(refusal(planned) + "only " + std::to_string(frames.size()) + " of " +
                      std::to_string(planned.pairs) + " pairs of one view came, of " + std::to_string(offered) +
                      " pairs in all" + why);
}

std::string CaseCapture::dropped(const PairPlace& place, const std::exception& error) const {
  const cortshift_stereo::DropReason drop = cortshift_stereo::dropReason(error);
  return "; the pair at " + seconds(place.arrival.toSec() - recording_.begin().toSec()) + " was dropped (" +
         drop.reason + "): " + drop.message;
}

}  // namespace cortshift_tracking
