#include "cortshift_tracking/ros/tracker/open_case.hpp"

#include <ros/ros.h>

#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/ros/run_folder.hpp"

namespace cortshift_tracking {

namespace {

std::filesystem::path caseFolder(const ShiftTrackerParameters& parameters) {
  if (!parameters.case_folder.empty()) return parameters.case_folder;
  try {
    return runPath("case");  // a restarted node finds its case again; another master starts another
  } catch (const TrackingError& error) {
    throw TrackingError("case_folder is empty and " + std::string(error.what()) + "; set case_folder");
  }
}

RegionsByKey configuredRegions(const ShiftTrackerParameters& parameters) {
  return parameters.exclusions.empty() ? RegionsByKey() : readRegions(parameters.exclusions);
}

}  // namespace

OpenCase::OpenCase(const ShiftTrackerParameters& parameters)
    : store(caseFolder(parameters)), state(store.folder(), {parameters.gravity_pmr, configuredRegions(parameters)}) {
  ROS_INFO_STREAM("case folder " << store.folder() << ", " << store.list().size()
                                 << " stages; to go on with this case later set case_folder to it");
  for (const std::string& line : store.warnings()) ROS_WARN_STREAM("case folder: " << line);
  for (const std::string& line : store.setAside()) ROS_ERROR_STREAM("case folder: not a stage: " << line);
  for (const std::string& line : store.unreadable())
    ROS_ERROR_STREAM("case folder: a stage stays but cannot be used: " << line);
  const std::string trouble = state.trouble();
  if (!trouble.empty()) ROS_ERROR_STREAM("case folder: " << trouble);
  try {
    if (const auto gravity = state.gravity()) ROS_INFO_STREAM("gravity is known: " << gravity->source);
  } catch (const UnreadableFile&) {  // trouble says so
  }
}

Directions OpenCase::directions() {
  const auto gravity = state.gravity();
  return {first_normal.of(store), gravity ? std::make_optional(gravity->direction_pmr) : std::nullopt};
}

}  // namespace cortshift_tracking
