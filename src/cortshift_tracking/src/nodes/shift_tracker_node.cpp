#include <ros/ros.h>

#include <exception>

#include "cortshift_stereo/heap.hpp"
#include "cortshift_tracking/ros/tracker/shift_tracker.hpp"

int main(int argc, char** argv) {
  cortshift_stereo::giveFreedMemoryBack();
  ros::init(argc, argv, "shift_tracker");
  const ros::NodeHandle private_node("~");  // outlives the try block: without any handle the log is shut down
  try {
    const auto parameters = cortshift_tracking::ShiftTrackerParameters::load(private_node);
    cortshift_tracking::ShiftTracker tracker(parameters, private_node);
    ros::waitForShutdown();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("shift_tracker does not start: " << error.what());
    return 1;
  }
  return 0;
}
