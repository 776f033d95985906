#include "cortshift_tracking/ros/tracker/open_case.hpp"

#include <ros/ros.h>

#include <cstdlib>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

std::string caseFolder(const ShiftTrackerParameters& parameters) {
  if (!parameters.case_folder.empty()) return parameters.case_folder;
  // A restarted node finds its case again; another master starts another.
  std::string run;
  if (!ros::param::get("/run_id", run) || run.empty())
    throw TrackingError("case_folder is empty and the master has no /run_id; set case_folder");
  const char* ros_home = std::getenv("ROS_HOME");
  const char* home = std::getenv("HOME");
  if (ros_home == nullptr && home == nullptr)
    throw TrackingError("case_folder is empty and HOME not set; set case_folder");
  return (ros_home != nullptr ? std::string(ros_home) : std::string(home) + "/.ros") + "/cortshift/case-" + run;
}

RegionsByKey configuredRegions(const ShiftTrackerParameters& parameters) {
  return parameters.exclusions.empty() ? RegionsByKey() : readRegions(parameters.exclusions);
}

}  // namespace

OpenCase::OpenCase(const ShiftTrackerParameters& parameters)
    : store(caseFolder(parameters)), state(store.folder(), {parameters.gravity_pmr, configuredRegions(parameters)}) {
  ROS_INFO_STREAM("case folder " << store.folder() << ", " << store.list().size()
                                 << " stages; to go on with this case later set case_folder to it");
}

Directions OpenCase::directions() {
  const auto gravity = state.gravity();
  return {first_normal.of(store), gravity ? std::make_optional(gravity->direction_pmr) : std::nullopt};
}

}  // namespace cortshift_tracking
