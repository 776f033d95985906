// What a node that is started again under the same master finds again, and another launch does not.
#pragma once

#include <filesystem>
#include <string>

namespace cortshift_tracking {

/// run_id of the master. @throws TrackingError where it has none
std::string masterRun();

/// ~/.ros/cortshift/NAME-RUN (or below ROS_HOME), one for each master and namespace. @throws TrackingError
std::filesystem::path runPath(const std::string& name);

}  // namespace cortshift_tracking
