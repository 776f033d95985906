// Stereo pairs of the microscope, from the source that the parameters name. See StereoDriver, PhantomRig and LiveRig
// for parameters, topics and services.
#include <ros/ros.h>

#include "cortshift_stereo/ros/driver/live_rig.hpp"
#include "cortshift_stereo/ros/driver/phantom_rig.hpp"
#include "cortshift_stereo/ros/driver/stereo_driver.hpp"

namespace cortshift_stereo {
namespace {

void run(const ros::NodeHandle& node, const ros::NodeHandle& private_node) {
  const auto parameters = StereoDriverParameters::load(private_node);
  // Enough threads that tracker and diagnostics go on while a pair, a trigger and a change of stage are under way.
  constexpr int kThreads = 6;
  ros::AsyncSpinner spinner(kThreads);
  if (parameters.source == "phantom") {
    PhantomRig rig(parameters);
    spinner.start();
    rig.prepare();
    if (!ros::ok()) return;  // stopped while the first stage was rendered; nothing may be advertised any more
    StereoDriver driver(node, private_node, parameters, rig.source(),
                        [&rig](Stamp time) { return rig.T_reference_microscope(time); });
    rig.offerStages(private_node);
    ros::waitForShutdown();
    spinner.stop();
  } else {
    LiveRig rig(parameters);
    spinner.start();
    StereoDriver driver(node, private_node, parameters, rig.source(),
                        [&rig](Stamp time) { return rig.T_reference_microscope(time); });
    ros::waitForShutdown();
    spinner.stop();
  }
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  ros::init(argc, argv, "stereo_driver");
  const ros::NodeHandle node, private_node("~");  // outside: without a handle nothing is logged any more
  try {
    cortshift_stereo::run(node, private_node);
  } catch (const std::exception& error) {
    ROS_FATAL_STREAM("stereo_driver cannot start: " << error.what());
    return 1;
  }
  return 0;
}
