// Parameters of the OpenIGTLink bridge; config/igtl_bridge.yaml names every one with its unit.
#pragma once

#include <ros/node_handle.h>

#include <string>

#include "cortshift_tracking/igtl/endpoint.hpp"
#include "cortshift_tracking/igtl/tool_board.hpp"

namespace cortshift_tracking::igt {

/// Each default is written here and nowhere else.
struct BridgeParameters {
  EndpointSettings endpoint;
  ToolBoardSettings board;
  std::string pmr_axes = "ras";
  std::string link_axes = "ras";
  double field_spacing = 0.0005;  ///< [m] between the vectors that are sent
  double surface_period = 1;      ///< [s] between surfaces that are sent
  int surface_step = 4;
  std::string vtk_folder;  ///< empty: no files
  std::string command_device = "cortshift";
  double stage_poll_period = 1;  ///< [s]
  int request_tracking_ms = 0;   ///< that peers are asked to send poses at; 0: not asked
  std::string launch;            ///< which one this node is of; empty: of none, which would start it again
};

/// @throws cortshift_stereo::ParameterError, std::invalid_argument naming the parameter, its value and what is allowed
BridgeParameters readBridgeParameters(const ros::NodeHandle& node);

}  // namespace cortshift_tracking::igt
