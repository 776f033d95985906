#include "cortshift_tracking/ros/tracker/health.hpp"

#include <algorithm>
#include <cstdio>

#include "cortshift_tracking/error.hpp"

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

}  // namespace

diagnostic_msgs::KeyValue entry(const std::string& key, const std::string& value) {
  diagnostic_msgs::KeyValue pair;
  pair.key = key;
  pair.value = value;
  return pair;
}

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
    const auto motion = watch.motionAt(ros::Time::now() - ros::Duration(*age + kDelay));
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

}  // namespace cortshift_tracking
