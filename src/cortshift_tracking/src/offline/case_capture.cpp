#include "cortshift_tracking/offline/case_capture.hpp"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cstdio>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/ros/pose_watch.hpp"
#include "cortshift_tracking/ros/registration.hpp"
#include "cortshift_tracking/ros/stage_record.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_stereo::PairMessages;

constexpr double kSlice = 1.0;  // [s] of recording that is looked through at one go

std::string seconds(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", value);
  return text;
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

StageRecord CaseCapture::recordOf(const PairPlace& place) const {
  const PairMessages messages = recording_.read(place);
  cortshift_stereo::SurfaceReconstructionParameters parameters = parameters_.reconstruction;
  if (!parameters.referenceSetting() && parameters.settings_calibration.empty())
    if (const auto reference = recording_.referenceSetting(messages)) {
      parameters.reference_magnification = reference->magnification;
      parameters.reference_focal_length = reference->focal_length;
    }
  cortshift_stereo::PairReconstruction reconstruct(parameters);
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
  const cortshift_stereo::PairSurface surface = surfaceOf(place, messages);

  StageRecord record;
  std_msgs::Header header;
  header.stamp = place.stamp;
  header.frame_id = parameters.map_frame;
  record.surface = boost::make_shared<sensor_msgs::PointCloud2>(toPointCloud2(surface.surface_map, header));
  record.info.stamp = place.stamp;
  record.left = messages.left.raw;
  record.right = messages.right.raw;
  record.left_compressed = messages.left.compressed;
  record.right_compressed = messages.right.compressed;
  record.left_info = messages.left_info;
  record.right_info = messages.right_info;
  record.settings = messages.settings;
  return record;
}

StageRecord CaseCapture::capture(const PlannedCapture& planned, std::string& remarks) const {
  const BagFile& bag = recording_.bag();
  const ros::Time asked = shifted(bag.begin(), planned.seconds);
  const double length = (bag.end() - bag.begin()).toSec();
  const double max_age = parameters_.tracker.max_surface_age;
  std::size_t tried = 0;
  ros::Time arrival;
  std::string why;
  const auto attempt = [&](const PairPlace& place, StageRecord& record) {
    ++tried;
    try {
      record = recordOf(place);
      arrival = place.arrival;
      return true;
    } catch (const std::exception& error) {
      const cortshift_stereo::DropReason drop = cortshift_stereo::dropReason(error);
      why = "; the pair at " + seconds((place.arrival - bag.begin()).toSec()) + " was dropped (" + drop.reason +
            "): " + drop.message;
      return false;
    }
  };
  const auto recent = [&](const PairPlace& place) { return asked.toSec() - place.stamp.toSec() <= max_age; };

  StageRecord record;
  const auto complete = [&] {
    try {
      const auto pose_at = recording_.posesAround(arrival, parameters_.tracker.max_pose_gap);
      if (const auto changed = recording_.registrationChanged(std::max(asked, arrival)))
        requireSettled(record.info.stamp, *changed);
      if (const auto motion = motionAround(record.info.stamp, pose_at))
        requireSlow(*motion, parameters_.tracker.max_speed);
      record.info.key = planned.key;
      record.info.note = planned.note;
      remarks = completeStage(record, pose_at);
      return record;
    } catch (const std::exception& error) {
      throw TrackingError("stage '" + planned.key + "' was not captured: " + error.what());
    }
  };
  std::vector<PairPlace> before = recording_.pairs(shifted(asked, -max_age - kSlice), asked);
  for (auto place = before.rbegin(); place != before.rend(); ++place)
    if (recent(*place) && attempt(*place, record)) return complete();
  const double timeout = parameters_.tracker.capture_timeout;
  for (double from = 0; from < timeout; from += kSlice)
    for (const PairPlace& place :
         recording_.pairs(shifted(asked, from), shifted(asked, std::min(from + kSlice, timeout))))
      if (recent(place) && attempt(place, record)) return complete();
  throw TrackingError("stage '" + planned.key + "' was not captured: no pair from " + seconds(max_age) + " before to " +
                      seconds(timeout) + " after " + seconds(planned.seconds) + " of the bag's " + seconds(length) +
                      " gives a surface, " + std::to_string(tried) + " tried" + why);
}

}  // namespace cortshift_tracking
