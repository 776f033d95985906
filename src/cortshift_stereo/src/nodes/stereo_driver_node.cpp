// Stereo pairs of the microscope, from the source that the parameters name. See runStereoDriver.
#include <ros/ros.h>

#include "cortshift_stereo/ros/driver/stereo_driver.hpp"

int main(int argc, char** argv) {
  ros::init(argc, argv, "stereo_driver");
  const ros::NodeHandle node, private_node("~");  // outside: without a handle nothing is logged any more
  try {
    cortshift_stereo::runStereoDriver(node, private_node);
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("stereo_driver cannot start: " << error.what());
    return 1;
  }
  return 0;
}
