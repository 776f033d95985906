// OpenIGTLink on one side, the graph on the other.
//
// Subscribes  /shift/field, /surface/points, /shift/overlay_before, /shift/overlay_after, /shift/magnitude,
//             /brain_model/updated_mr, /brain_model/overlay
// Publishes   /tf (reference -> tools), /tf_static (pmr -> reference), /diagnostics
// Calls       /shift_tracker/capture_stage, /shift_tracker/compute_shift, /shift_tracker/list_stages
// To peers    POLYDATA ShiftField, Surface, Now_LABEL; IMAGE FieldTexture, UpdatedMr (in their place in the patient)
// and
//             the pictures OverlayBeforePict, OverlayAfterPict, MagnitudePict, BrainOverlayPict (for a 2D view: they
//             have no place in the patient); STRING ShiftSummary, Stages, StageEvent, CortshiftReply; NDARRAY
//             ShiftSummaryValues
// From peers  TRANSFORM, TDATA, POSITION, STATUS of the configured tools; STRING (device `command_device`) and COMMAND:
//             capture_stage KEY [NOTE], compute_shift FROM TO; GET_STATUS
// Parameters  config/igtl_bridge.yaml names every one with its unit.
#include <ros/ros.h>
#include <sysexits.h>

#include <optional>

#include "cortshift_tracking/ros/bridge/bridge.hpp"

int main(int argc, char** argv) {
  ros::init(argc, argv, "igtl_bridge");
  ros::NodeHandle node;  // outside: without a handle nothing is logged any more
  std::optional<cortshift_tracking::igt::Bridge> bridge;
  try {
    bridge.emplace(node, cortshift_tracking::igt::readBridgeParameters(ros::NodeHandle("~")));
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("igtl_bridge cannot start: " << error.what());
    return 1;
  }
  try {
    ros::spin();
  } catch (const std::exception& error) {  // no fault of the configuration: script/supervise tells the two apart
    ROS_FATAL_STREAM("igtl_bridge ends: " << error.what());
    return EX_SOFTWARE;
  }
  return 0;
}
