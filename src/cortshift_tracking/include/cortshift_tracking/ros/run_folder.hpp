// What is one graph's own: where it keeps what a node that is started again finds again, and the names of its statuses.
#pragma once

#include <filesystem>
#include <string>

namespace cortshift_tracking {

/// run_id of the master. @throws TrackingError where it has none
std::string masterRun();

/// ~/.ros/cortshift/NAME-RUN (or below ROS_HOME), one for each master and namespace. @throws TrackingError
std::filesystem::path runPath(const std::string& name);

/// Name of a status on /diagnostics, which all graphs share: "NODE: WHAT", or "or1/NODE: WHAT" for a graph in /or1.
std::string statusName(const std::string& name);

}  // namespace cortshift_tracking
