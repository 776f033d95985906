#include "cortshift_stereo/ros/driver/live_rig.hpp"
#include "cortshift_stereo/ros/driver/phantom_rig.hpp"
#include "cortshift_stereo/ros/driver/stereo_driver.hpp"

namespace cortshift_stereo {

void runStereoDriver(const ros::NodeHandle& node, const ros::NodeHandle& private_node) {
  const auto parameters = StereoDriverParameters::load(private_node);
  // Enough threads that tracker and diagnostics go on while a pair, a trigger and a change of stage are under way.
  constexpr int kThreads = 6;
  ros::AsyncSpinner spinner(kThreads);
  if (parameters.source == "phantom") {
    PhantomRig rig(node, private_node, parameters);
    spinner.start();
    rig.prepare();
    if (!ros::ok()) return;  // stopped while the first stage was rendered; nothing may be advertised any more
    StereoDriver driver(node, private_node, parameters, rig.source(),
                        [&rig](Stamp time) { return rig.T_reference_microscope(time); });
    rig.offerStages();
    ros::waitForShutdown();
    spinner.stop();
  } else {
    LiveRig rig(node, private_node, parameters);
    spinner.start();
    StereoDriver driver(node, private_node, parameters, rig.source(),
                        [&rig](Stamp time) { return rig.T_reference_microscope(time); });
    ros::waitForShutdown();
    spinner.stop();
  }
}

}  // namespace cortshift_stereo
