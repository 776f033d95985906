// What is asked and told about a case without computing anything.
#pragma once

#include <cortshift_msgs/DeleteStage.h>
#include <cortshift_msgs/ExcludeRegions.h>
#include <cortshift_msgs/ListStages.h>
#include <cortshift_msgs/SetGravity.h>
#include <cortshift_msgs/SetOutline.h>
#include <ros/node_handle.h>
#include <ros/service_callback_helper.h>
#include <ros/service_server.h>

#include "cortshift_tracking/ros/tracker/open_case.hpp"

namespace cortshift_tracking {

/// What is changed is on the disk before the service answers. What is deleted stands in the case's own log,
/// case_log.txt: when, which stage of when, and the node that asked.
///
/// Services: ~list_stages, ~delete_stage, ~set_gravity, ~exclude_regions, ~set_outline
class CaseServices {
 public:
  CaseServices(OpenCase& open, ros::NodeHandle& services);

 private:
  bool onList(cortshift_msgs::ListStages::Request& request, cortshift_msgs::ListStages::Response& response);
  using DeleteEvent = ros::ServiceEvent<cortshift_msgs::DeleteStage::Request, cortshift_msgs::DeleteStage::Response>;
  bool onDelete(DeleteEvent& event);
  bool onGravity(cortshift_msgs::SetGravity::Request& request, cortshift_msgs::SetGravity::Response& response);
  bool onExclude(cortshift_msgs::ExcludeRegions::Request& request, cortshift_msgs::ExcludeRegions::Response& response);
  bool onOutline(cortshift_msgs::SetOutline::Request& request, cortshift_msgs::SetOutline::Response& response);

  OpenCase& case_;
  ros::ServiceServer list_, delete_, set_gravity_, exclude_, outline_;
};

}  // namespace cortshift_tracking
