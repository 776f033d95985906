/// stereo_to_shift [--without-driver]
///
/// stereo_driver, surface_reconstruction and shift_tracker in one process: images and surfaces pass from one to the
/// next as pointers, not through sockets. Names of parameters, topics, services and diagnostics are those of the three
/// nodes.
/// --without-driver: the pairs come from elsewhere, as of a recording.
#include <ros/ros.h>

#include <string>

#include "cortshift_stereo/heap.hpp"
#include "cortshift_stereo/ros/driver/stereo_driver.hpp"
#include "cortshift_stereo/ros/reconstruction/surface_reconstruction.hpp"
#include "cortshift_tracking/ros/tracker/shift_tracker.hpp"

int main(int argc, char** argv) {
  cortshift_stereo::giveFreedMemoryBack();
  ros::init(argc, argv, "stereo_to_shift");
  const bool with_driver = argc == 1;
  if (argc > 2 || (argc == 2 && std::string(argv[1]) != "--without-driver")) {
    ROS_FATAL("stereo_to_shift takes one argument at most, --without-driver");
    return 1;  // ends the launch
  }
  const ros::NodeHandle node;  // outlives the try block: without any handle the log is shut down
  std::string part;
  const auto handleOf = [&part](const std::string& name) { return ros::NodeHandle(part = name); };
  try {
    const ros::NodeHandle of_tracker = handleOf("shift_tracker");
    const auto tracker_parameters = cortshift_tracking::ShiftTrackerParameters::load(of_tracker);
    const cortshift_tracking::ShiftTracker tracker(tracker_parameters, of_tracker);
    const ros::NodeHandle of_reconstruction = handleOf("surface_reconstruction");
    const auto parameters = cortshift_stereo::SurfaceReconstructionParameters::load(of_reconstruction);
    const cortshift_stereo::SurfaceReconstruction reconstruction(node, of_reconstruction, parameters);
    if (with_driver)
      cortshift_stereo::runStereoDriver(node, handleOf("stereo_driver"));
    else
      ros::waitForShutdown();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM(part << " cannot start: " << error.what());
    return 1;
  }
  return 0;
}
