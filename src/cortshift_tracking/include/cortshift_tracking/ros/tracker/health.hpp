// Diagnostics of what a case lives on: the tracker's pose, the disk and its last stage.
#pragma once

#include <diagnostic_msgs/DiagnosticStatus.h>

#include <string>

#include "cortshift_tracking/case/stage_store.hpp"
#include "cortshift_tracking/ros/tracker/pose_watch.hpp"

namespace cortshift_tracking {

diagnostic_msgs::KeyValue entry(const std::string& key, const std::string& value);

/// Age of the newest pose of the camera in pmr, its speed and jitter. @param max_pose_gap  [s]
diagnostic_msgs::DiagnosticStatus poseStatus(const PoseWatch& watch, double max_pose_gap, double max_speed);

/// Space left where the stages go, number of stages and epochs, the last stage.
diagnostic_msgs::DiagnosticStatus caseStatus(const StageStore& store);

}  // namespace cortshift_tracking
