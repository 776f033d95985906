// Stereo pairs to textured surfaces in pMR space. See SurfaceReconstruction for parameters and topics.
#include <ros/ros.h>
#include <sysexits.h>

#include <optional>

#include "cortshift_stereo/heap.hpp"
#include "cortshift_stereo/ros/parameter_reader.hpp"
#include "cortshift_stereo/ros/surface_reconstruction.hpp"

int main(int argc, char** argv) {
  cortshift_stereo::keepFreedMemory();
  ros::init(argc, argv, "surface_reconstruction");
  const ros::NodeHandle node;  // outlives the try block: without any handle ROS, and with it the log, is shut down
  std::optional<cortshift_stereo::SurfaceReconstruction> reconstruction;
  try {
    reconstruction.emplace(node, cortshift_stereo::SurfaceReconstructionParameters::load(ros::NodeHandle("~")));
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("surface_reconstruction cannot start: " << error.what());
    return 1;
  }
  try {
    ros::spin();
  } catch (const std::exception& error) {  // no fault of the configuration: script/supervise tells the two apart
    ROS_FATAL_STREAM("surface_reconstruction ends: " << error.what());
    return EX_SOFTWARE;
  }
  return 0;
}
