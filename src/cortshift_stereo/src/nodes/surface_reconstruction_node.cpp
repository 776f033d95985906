// Stereo pairs to textured surfaces in pMR space. See SurfaceReconstruction for parameters and topics.
#include <ros/ros.h>

#include "cortshift_stereo/heap.hpp"
#include "cortshift_stereo/ros/reconstruction/surface_reconstruction.hpp"

int main(int argc, char** argv) {
  cortshift_stereo::keepFreedMemory();
  ros::init(argc, argv, "surface_reconstruction");
  const ros::NodeHandle node, private_node("~");  // outlive the try block: without a handle the log is shut down
  try {
    const auto parameters = cortshift_stereo::SurfaceReconstructionParameters::load(private_node);
    cortshift_stereo::SurfaceReconstruction reconstruction(node, private_node, parameters);
    ros::waitForShutdown();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("surface_reconstruction cannot start: " << error.what());
    return 1;
  }
  return 0;
}
