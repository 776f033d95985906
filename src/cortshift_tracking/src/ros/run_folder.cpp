#include "cortshift_tracking/ros/run_folder.hpp"

#include <ros/param.h>
#include <ros/this_node.h>

#include <algorithm>
#include <cstdlib>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

std::string masterRun() {
  std::string run;
  if (!ros::param::get("/run_id", run) || run.empty()) throw TrackingError("the master has no /run_id");
  return run;
}

std::filesystem::path runPath(const std::string& name) {
  const char* ros_home = std::getenv("ROS_HOME");
  const char* home = std::getenv("HOME");
  if (ros_home == nullptr && home == nullptr) throw TrackingError("neither ROS_HOME nor HOME is set");
  std::string space = ros::this_node::getNamespace();  // "/", or "/or1": two graphs under one master are two cases
  std::replace(space.begin(), space.end(), '/', '-');
  if (space == "-") space.clear();
  return (ros_home != nullptr ? std::filesystem::path(ros_home) : std::filesystem::path(home) / ".ros") / "cortshift" /
         (name + "-" + masterRun() + space);
}

std::string statusName(const std::string& name) {
  const std::string space = ros::this_node::getNamespace();
  return space == "/" || space.empty() ? name : space.substr(1) + "/" + name;
}

}  // namespace cortshift_tracking
