#include "cortshift_tracking/ros/tracker/live_tracking.hpp"

#include <ros/console.h>

#include <chrono>
#include <optional>

#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/case/stage_record.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/ros/field_message.hpp"
#include "cortshift_tracking/ros/run_folder.hpp"
#include "cortshift_tracking/ros/stage_shift.hpp"

namespace cortshift_tracking {
namespace {

constexpr std::chrono::milliseconds kLook(200);   // for a new surface, before looking whether to go on
constexpr std::chrono::milliseconds kPause(500);  // after the stage could not be made ready
const ros::WallDuration kPoseWait(0.05);          // for tracker samples that are behind the surface made with them

/// The stage that the live mode started from is not there any more.
class StageIsGone : public TrackingError {
 public:
  using TrackingError::TrackingError;
};

void requireThere(const StageStore& store, const cortshift_msgs::StageInfo& from) {
  for (const cortshift_msgs::StageInfo& stage : store.list())
    if (stage.key == from.key && stage.stamp == from.stamp) return;
  throw StageIsGone("live mode has ended: stage '" + from.key +
                    "' that it started from is deleted; start it from another");
}

}  // namespace

LiveTracking::LiveTracking(const ShiftTrackerParameters& parameters, OpenCase& open, Placement& placement,
                           const SurfaceFeed& feed, const PairHistory& pairs, FieldPublisher& publisher,
                           Activity& activity, ros::NodeHandle& services)
    : settings_(parameters.shift),
      case_(open),
      placement_(placement),
      feed_(feed),
      pairs_(pairs),
      publisher_(publisher),
      activity_(activity),
      track_(services.advertiseService("track", &LiveTracking::onTrack, this)) {
  settings_.frame.resolution = parameters.track_resolution;
  goOn();
}

LiveTracking::~LiveTracking() { stop(); }

bool LiveTracking::onTrack(cortshift_msgs::TrackShift::Request& request,
                           cortshift_msgs::TrackShift::Response& response) {
  try {
    const std::lock_guard<std::mutex> guard(switch_mutex_);
    std::optional<cortshift_msgs::StageInfo> from;
    if (request.on) from = case_.store.load(request.key).info;  // before anything is stopped
    stop();
    if (from) begin(*from);
    response.success = true;
    response.message = request.on ? "tracking the shift from '" + request.key + "'" : "tracking is off";
    try {
      case_.state.setLive(from ? std::make_optional(LiveMode{from->key, from->stamp, masterRun()}) : std::nullopt);
    } catch (const TrackingError& error) {
      response.message += "; should this node be started again it would not know: " + std::string(error.what());
    }
  } catch (const std::exception& error) {
    response.success = false;
    response.message = error.what();
  }
  return true;
}

void LiveTracking::begin(const cortshift_msgs::StageInfo& from) {
  say(true, from.key, "");
  wanted_ = true;
  thread_ = std::thread(&LiveTracking::run, this, from);
}

/// What a node that died was doing. Another launch begins with live mode off: nobody there has asked for it.
void LiveTracking::goOn() {
  try {
    const auto live = case_.state.live();
    if (!live || live->run != masterRun()) return;
    for (const cortshift_msgs::StageInfo& stage : case_.store.list()) {
      if (stage.key != live->key || stage.stamp != live->stamp) continue;
      ROS_WARN_STREAM("live mode goes on from '" << stage.key << "': this node has been started again");
      return begin(stage);
    }
  } catch (const TrackingError& error) {
    ROS_ERROR_STREAM("whether live mode was on is not known: " << error.what());
  }
}

void LiveTracking::stop() {
  wanted_ = false;
  if (thread_.joinable()) thread_.join();
  say(false, "", "");
}

void LiveTracking::say(bool on, const std::string& from, const std::string& trouble) {
  const std::lock_guard<std::mutex> guard(report_mutex_);
  report_ = {on, from, trouble};
}

LiveTracking::Report LiveTracking::report() const {
  const std::lock_guard<std::mutex> guard(report_mutex_);
  return report_;
}

/// Of a surface that is no stage: what a stage of it would say of pose, registration and calibration.
cortshift_msgs::StageInfo LiveTracking::stateAt(const ros::Time& stamp) const {
  StageRecord record;
  record.info.stamp = stamp;
  pairs_.fillCalibration(record);
  placeRecord(record, placement_.poses.source(kPoseWait, placement_.limits), settings_.surround.pose_latency_sd);
  record.info.registration = placement_.registration.newest();  // of a later time too: it makes the stage a wrong start
  record.info.warnings.clear();  // a pose that is not known is told by the surface's own status
  return record.info;
}

void LiveTracking::run(const cortshift_msgs::StageInfo& from) {
  std::optional<Reference> reference;
  StageRecord start;  // of it, without its images and points
  start.info = from;
  std::vector<Region> excluded;  // in the reference
  unsigned long seen = 0;
  ros::Time taken;
  cv::Mat prediction;  // from the field before
  const auto prepare = [&] {
    requireThere(case_.store, from);
    const std::vector<Region> regions = case_.state.regionsOf(from);
    if (reference && regions == excluded) return;
    const StageRecord record = case_.store.load(from.key);
    const std::lock_guard<std::mutex> guard(case_.computing);
    reference = prepareReference(cortshift_stereo::surfaceFromPointCloud2(*record.surface), settings_, regions);
    start.left_info = record.left_info;
    start.right_info = record.right_info;
    excluded = regions;
  };
  while (wanted_) {
    try {
      prepare();
      const sensor_msgs::PointCloud2ConstPtr surface = feed_.waitForNewer(seen, taken, kLook);
      if (!surface) continue;
      taken = surface->header.stamp;
      prepare();  // what was excluded during the wait counts already
      cortshift_msgs::StageInfo to = stateAt(surface->header.stamp);
      if (const auto change = changeBetween(from, to))
        throw TrackingError(*change + "; capture a stage and track from that");
      const std::lock_guard<std::mutex> guard(case_.computing);
      const Directions directions = case_.directions();
      ShiftResult result =
          computeShift(*reference, cortshift_stereo::surfaceFromPointCloud2(*surface), directions, settings_,
                       prediction, knowledgeOf(start, to, settings_.surround, case_.state.outlineOf(from)));
      if (const auto status = feed_.statusOf(to.stamp)) to.warnings = status->warnings;
      cortshift_stereo::addWarnings(result.summary.warnings, warningsOf(from, to));
      prediction = predictionOf(result.flow, result.field.confidence);
      requireThere(case_.store, from);  // nothing is published of a stage that was deleted meanwhile
      publisher_.publish(result, directions, from, to, true);
      activity_.tracked("live from " + from.key + ": " + toText(result.summary));
      say(true, from.key, "");
    } catch (const StageIsGone& error) {
      ROS_WARN_STREAM(error.what());
      activity_.refused(error.what());
      say(false, "", error.what());
      return;
    } catch (const std::exception& error) {  // the next surface may be better
      prediction.release();
      ROS_WARN_STREAM_THROTTLE(2, "tracking from '" << from.key << "': " << error.what());
      activity_.refused(error.what());
      say(true, from.key, error.what());
      if (!reference) std::this_thread::sleep_for(kPause);
    }
  }
}

}  // namespace cortshift_tracking
