// Stereo pairs of the microscope, from the source that the parameters name. See StereoDriver and PhantomRig for
// parameters, topics and services.
#include <ros/ros.h>

#include "cortshift_stereo/ros/phantom_rig.hpp"
#include "cortshift_stereo/ros/stereo_driver.hpp"

int main(int argc, char** argv) {
  ros::init(argc, argv, "stereo_driver");
  try {
    const ros::NodeHandle node, private_node("~");
    const auto parameters = cortshift_stereo::StereoDriverParameters::load(private_node);
    cortshift_stereo::PhantomRig rig(parameters);
    // Enough threads that tracker and diagnostics go on while a pair, a trigger and a change of stage are under way.
    constexpr int kThreads = 6;
    ros::AsyncSpinner spinner(kThreads);
    spinner.start();
    rig.prepare();
    cortshift_stereo::StereoDriver driver(
        node, private_node, parameters, rig.source(),
        [&rig](cortshift_stereo::Stamp time) { return rig.T_reference_microscope(time); });
    rig.offerStages(private_node);
    ros::waitForShutdown();
    spinner.stop();
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("stereo_driver cannot start: " << error.what());
    return 1;
  }
  return 0;
}
