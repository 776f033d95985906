#include "cortshift_stereo/ros/driver/live_parameters.hpp"

#include "cortshift_stereo/ros/parameter_reader.hpp"

namespace cortshift_stereo {
namespace {

void readCamera(ParameterReader& reader, const std::string& prefix, AravisCameraSettings& camera) {
  reader.choice(prefix + "/device", camera.device);
  reader.choice(prefix + "/trigger_source", camera.trigger_source);
  reader.texts(prefix + "/features", camera.features);
}

}  // namespace

void LiveParameters::read(ParameterReader& reader) {
  reader.choice("calibration_left", calibration_left);
  reader.choice("calibration_right", calibration_right);
  reader.choice("hand_eye", hand_eye);
  reader.number("max_pose_gap", max_pose_gap, 0.001, 1.0);
  readCamera(reader, "aravis/left", aravis.left);
  readCamera(reader, "aravis/right", aravis.right);
  reader.choice("aravis/pixel_format", aravis.pixel_format);
  reader.number("aravis/exposure", aravis.exposure, 1e-6, 1.0);
  reader.number("aravis/gain", aravis.gain, -100.0, 1000.0);
  reader.number("aravis/frame_rate", aravis.frame_rate, 0.1, 200.0);
  reader.number("aravis/sync_tolerance", aravis.sync_tolerance, 1e-6, 0.1);
  reader.number("aravis/timeout", aravis.timeout, 0.05, 30.0);
  reader.number("aravis/transfer_delay", aravis.transfer_delay, 0.0, 1.0);
  reader.number("aravis/packet_size", aravis.packet_size, 0, 16000);
  reader.flag("aravis/packet_socket", aravis.packet_socket);
  reader.number("aravis/frame_retention", aravis.frame_retention, 0.001, 10.0);
  reader.number("aravis/reconnect_min", aravis.reconnect_min, 0.05, 60.0);
  reader.number("aravis/reconnect_max", aravis.reconnect_max, 0.05, 600.0);
  reader.choice("folder", folder);
  reader.flag("loop", loop);
  reader.number("image_bits", image_bits, 0, 16);
}

void LiveParameters::require(const std::string& source, const std::string& name_space) const {
  const auto missing = [&](const std::string& key, const std::string& what) {
    throw ParameterError("parameter " + name_space + "/" + key + " is missing; source " + source + " needs " + what);
  };
  if (calibration_left.empty()) missing("calibration_left", "the camera_info YAML of the left camera");
  if (calibration_right.empty()) missing("calibration_right", "the camera_info YAML of the right camera");
  if (source == "folder" && folder.empty()) missing("folder", "the path of the images");
  if (source != "aravis") return;
  try {
    aravis.validate();
  } catch (const std::invalid_argument& error) {
    throw ParameterError("parameters " + name_space + "/aravis: " + error.what());
  }
}

}  // namespace cortshift_stereo
