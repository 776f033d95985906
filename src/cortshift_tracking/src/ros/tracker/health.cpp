#include "cortshift_tracking/ros/tracker/health.hpp"

#include <diagnostic_msgs/DiagnosticArray.h>

#include <cstdio>

#include "cortshift_stereo/ros/shifted_time.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/ros/run_folder.hpp"

namespace cortshift_tracking {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kGigabyte = 1e9;
constexpr double kLittleDisk = 5.0;  // [GB] some hundred stages, or ten minutes of recording
constexpr double kDelay = 0.25;      // [s] of samples that are under way, and of a tracker that is slow

std::string number(double value, int digits) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

diagnostic_msgs::KeyValue entry(const std::string& key, const std::string& value) {
  diagnostic_msgs::KeyValue pair;
  pair.key = key;
  pair.value = value;
  return pair;
}

DiagnosticStatus stagesStatus(const StageStore& store, const Activity::Report& activity) {
  DiagnosticStatus status;
  status.name = "shift_tracker: stages";
  const std::vector<std::string>&aside = store.setAside(), unreadable = store.unreadable();
  status.level = aside.empty() ? DiagnosticStatus::OK : DiagnosticStatus::WARN;
  status.message = aside.empty() ? "ok" : std::to_string(aside.size()) + " files of the case folder are not stages";
  if (!unreadable.empty()) {
    status.level = DiagnosticStatus::ERROR;
    status.message = std::to_string(unreadable.size()) + " stages cannot be read: " + unreadable.front();
  }
  status.values = {entry("case_folder", store.folder().string()), entry("stages", std::to_string(store.list().size()))};
  for (const std::string& file : aside) status.values.push_back(entry("set_aside", file));
  for (const std::string& file : unreadable) status.values.push_back(entry("unreadable", file));
  status.values.push_back(entry("last_shift", activity.last_shift));
  status.values.push_back(entry("tracked_fields", std::to_string(activity.tracked)));
  status.values.push_back(entry("last_refusal", activity.last_refusal));
  return status;
}

DiagnosticStatus surfacesStatus(const SurfaceFeed& feed) {
  DiagnosticStatus status;
  const SurfaceFeed::Report report = feed.report();
  status.name = "shift_tracker: surfaces";
  const bool bad = !report.last_malformed.empty();
  status.level = bad ? DiagnosticStatus::ERROR : DiagnosticStatus::OK;
  status.message = bad ? "the last surface is not usable: " + report.last_malformed : "ok";
  if (!bad && !report.clock.empty()) {
    status.level = DiagnosticStatus::WARN;
    status.message = report.clock;
  }
  status.values = {entry("received", std::to_string(report.received)),
                   entry("malformed", std::to_string(report.malformed)),
                   entry("newest_stamp", std::to_string(feed.inbox().newestStamp().toSec()))};
  return status;
}

}  // namespace

DiagnosticStatus poseStatus(const PoseWatch& watch, double max_pose_gap, double max_speed) {
  DiagnosticStatus status;
  status.name = "shift_tracker: pose";
  status.level = DiagnosticStatus::OK;
  status.message = "ok";
  const auto warn = [&status](const std::string& message) {
    status.level = DiagnosticStatus::WARN;
    status.message = message;
  };
  const auto age = watch.age();
  if (!age) {
    warn("the pose of the camera in pmr is not known");
    return status;
  }
  status.values.push_back(entry("pose_age_s", number(*age, 2)));
  if (*age > max_pose_gap + kDelay)
    warn("the newest pose is " + number(*age, 1) + " s old: the tracker does not see the microscope");
  try {
    const auto motion = watch.motionAt(cortshift_stereo::shifted(ros::Time::now(), -(*age + kDelay)));
    if (!motion) return status;
    status.values.push_back(entry("speed_mm_per_s", number(1000 * motion->speed, 2)));
    status.values.push_back(entry("jitter_mm", number(1000 * motion->jitter, 3)));
    if (motion->speed > max_speed) warn("the microscope moves");
  } catch (const TrackingError& error) {
    warn(error.what());
  }
  return status;
}

DiagnosticStatus caseStatus(const StageStore& store) {
  DiagnosticStatus status;
  status.name = "shift_tracker: case";
  status.level = DiagnosticStatus::OK;
  status.message = "ok";
  std::error_code error;
  const auto space = std::filesystem::space(store.folder(), error);
  if (error) {
    status.level = DiagnosticStatus::ERROR;
    status.message = "the case folder cannot be asked for its space: " + error.message();
  } else {
    const double left = static_cast<double>(space.available) / kGigabyte;
    status.values.push_back(entry("disk_left_GB", number(left, 1)));
    if (left < kLittleDisk) {
      status.level = DiagnosticStatus::WARN;
      status.message = "only " + number(left, 1) + " GB are left for the case";
    }
  }
  const auto stages = store.list();
  status.values.push_back(entry("stages", std::to_string(stages.size())));
  if (stages.empty()) return status;
  const cortshift_msgs::StageInfo& last = stages.back();
  status.values.push_back(entry("last_stage", last.key));
  status.values.push_back(entry("last_stage_stamp", std::to_string(last.stamp.toSec())));
  status.values.push_back(entry("last_stage_coverage", number(last.coverage, 3)));
  status.values.push_back(entry("epoch", std::to_string(last.epoch)));
  return status;
}

DiagnosticStatus stateStatus(const OpenCase& open, const LiveTracking::Report& live) {
  DiagnosticStatus status;
  status.name = "shift_tracker: state";
  status.level = DiagnosticStatus::OK;
  status.message = live.on ? "live from " + live.from : "ok";
  if (!live.trouble.empty()) {
    status.level = DiagnosticStatus::WARN;
    status.message = live.on ? "live mode gives no field: " + live.trouble : live.trouble;
  }
  std::string gravity = "not known", gravity_from, excluded;
  try {
    if (const auto known = open.state.gravity()) {
      const Eigen::Vector3d& down = known->direction_pmr;
      gravity = number(down.x(), 4) + " " + number(down.y(), 4) + " " + number(down.z(), 4);
      gravity_from = known->source;
    }
    for (const auto& [key, regions] : open.state.regions(open.store.list()))
      excluded += (excluded.empty() ? "" : ", ") + key;
  } catch (const TrackingError&) {  // trouble below says so
  }
  const std::string trouble = open.state.trouble();
  if (!trouble.empty()) {
    status.level = DiagnosticStatus::ERROR;
    status.message = trouble;
  }
  status.values = {entry("gravity", gravity),          entry("gravity_from", gravity_from),
                   entry("excluded_stages", excluded), entry("live", live.on ? "on" : "off"),
                   entry("live_from", live.from),      entry("live_trouble", live.trouble)};
  return status;
}

Health::Health(const ShiftTrackerParameters& parameters, const OpenCase& open, const Placement& placement,
               const SurfaceFeed& feed, const Activity& activity, const LiveTracking& live, ros::NodeHandle& node)
    : max_pose_gap_(parameters.max_pose_gap),
      max_speed_(parameters.max_speed),
      case_(open),
      placement_(placement),
      feed_(feed),
      activity_(activity),
      live_(live),
      publisher_(node.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 10)),
      timer_(node.createWallTimer(ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) { publish(); })) {}

void Health::publish() const {
  diagnostic_msgs::DiagnosticArray message;
  message.header.stamp = ros::Time::now();
  message.status = {stagesStatus(case_.store, activity_.report()), surfacesStatus(feed_),
                    poseStatus(placement_.watch, max_pose_gap_, max_speed_), caseStatus(case_.store),
                    stateStatus(case_, live_.report())};
  for (DiagnosticStatus& status : message.status) status.name = statusName(status.name);
  publisher_.publish(message);
}

}  // namespace cortshift_tracking
