#include "cortshift_stereo/ros/driver/stereo_driver.hpp"
#include "cortshift_stereo/ros/parameter_reader.hpp"

namespace cortshift_stereo {

StereoDriverParameters StereoDriverParameters::load(const ros::NodeHandle& private_node) {
  StereoDriverParameters p;
  ParameterReader reader(private_node);
  reader.required("source", p.source);
  reader.number("rate", p.rate, 0.0, 30.0);
  reader.choice("phantom_case", p.phantom_case);
  reader.choice("stage", p.stage);
  reader.number("move_time", p.move_time, 0.0, 60.0);
  reader.number("probe_dwell", p.probe_dwell, 0.1, 600.0);
  reader.number("probe_travel", p.probe_travel, 0.1, 60.0);
  reader.number("tracker_rate", p.tracker_rate, 1.0, 500.0);
  reader.number("tracker_latency", p.tracker_latency, 0.0, 1.0);
  reader.number("tracker_jitter", p.tracker_jitter, 0.0, 0.1);
  reader.number("tracker_jitter_angle", p.tracker_jitter_angle, 0.0, 0.5);
  reader.number("probe_jitter", p.probe_jitter, 0.0, 0.01);
  reader.number("tracker_dropouts", p.tracker_dropouts, 0.0, 100.0);
  reader.number("tracker_dropout_length", p.tracker_dropout_length, 0.0, 60.0);
  reader.number("tracker_seed", p.tracker_seed, 0, 1000000000);
  reader.choice("fault_images", p.fault_images, {"none", "blank", "saturated", "swapped"});
  reader.number("fault_stamp_offset", p.fault_stamp_offset, -1.0, 1.0);
  reader.flag("fault_no_camera_info", p.fault_no_camera_info);
  reader.flag("fault_no_tracker", p.fault_no_tracker);
  p.live.read(reader);
  reader.finish();

  const std::string name = private_node.getNamespace() + "/source = " + p.source;
  if (p.source == "none")
    throw ParameterError(
        "parameter " + name +
        ": no cameras are configured; set source in config/site.yaml. Built in: phantom, aravis, folder");
  if (p.source == "aravis" || p.source == "folder") {
    p.live.require(p.source, private_node.getNamespace());
    return p;
  }
  if (p.source != "phantom")
    throw ParameterError("parameter " + name + " is not a source of this build; set source in config/site.yaml. " +
                         "Built in: phantom, aravis, folder");
  if (p.phantom_case.empty())
    throw ParameterError("parameter " + private_node.getNamespace() +
                         "/phantom_case is missing; source phantom needs the path of a case, for instance " +
                         "config/phantom/phantom_case.yaml");
  return p;
}

}  // namespace cortshift_stereo
