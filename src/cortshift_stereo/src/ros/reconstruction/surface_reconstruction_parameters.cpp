#include "cortshift_stereo/ros/reconstruction/surface_reconstruction_parameters.hpp"

#include "cortshift_stereo/reconstruction_limits.hpp"
#include "cortshift_stereo/ros/parameter_reader.hpp"
#include "cortshift_stereo/ros/parameter_writer.hpp"

namespace cortshift_stereo {

std::optional<MicroscopeSetting> SurfaceReconstructionParameters::referenceSetting() const {
  if (reference_magnification == 0) return std::nullopt;
  return MicroscopeSetting{reference_magnification, reference_focal_length};
}

namespace {

/// Every parameter once, for reading and for writing down.
template <typename Reader, typename Parameters>
void each(Reader& reader, Parameters& p) {
  reader.choice("map_frame", p.map_frame);
  reader.choice("camera_frame", p.camera_frame);
  reader.choice("right_camera_frame", p.right_camera_frame);
  reader.number("sync_tolerance", p.sync_tolerance, 0.0, 0.1);
  reader.number("pair_timeout", p.pair_timeout, 0.05, 10.0);
  reader.number("max_pose_gap", p.max_pose_gap, 0.001, 2.0);
  reader.number("tracker_jitter", p.poses.tracker_jitter, 0.00001, 0.01);
  reader.number("pose_timeout", p.pose_timeout, 0.0, 10.0);
  reader.number("calibration_timeout", p.calibration_timeout, 0.0, 10.0);
  reader.choice("settings_calibration", p.settings_calibration);
  reader.number("reference_magnification", p.reference_magnification, 0.0, 100.0);
  reader.number("reference_focal_length", p.reference_focal_length, 0.0, 10.0);
  reader.number("settings_tolerance", p.settings_tolerance, 0.0, 0.1);
  reader.number("image_bits", p.image_bits, 0, 16);
  reader.number("average_pairs", p.average_pairs, 1, 64);
  reader.number("average_window", p.average.age, 0.01, 60.0);
  reader.number("average_max_translation", p.average.translation, 0.0, 0.1);
  reader.number("average_max_rotation", p.average.rotation, 0.0, 0.5);
  for (const ReconstructionLimit& limit : reconstructionLimits())
    reader.number(limit.name, limit.in(p.reconstruction), limit.low, limit.high);
}

}  // namespace

std::string SurfaceReconstructionParameters::effective() const {
  ParameterWriter writer;
  each(writer, *this);
  return writer.without();
}

SurfaceReconstructionParameters SurfaceReconstructionParameters::load(const ParameterSource& source) {
  SurfaceReconstructionParameters p;
  ParameterReader reader(source);
  each(reader, p);
  reader.finish();
  if ((p.reference_magnification == 0) != (p.reference_focal_length == 0))
    throw ParameterError("of reference_magnification and reference_focal_length one is given and the other is not");
  if (p.image_bits > 0 && p.image_bits < 8)
    throw ParameterError("parameter image_bits = " + std::to_string(p.image_bits) +
                         " is not allowed; allowed is 8 ... 16, or 0 to recognise them");
  try {
    p.reconstruction.validate();
  } catch (const std::invalid_argument& error) {
    throw ParameterError(std::string("parameters: ") + error.what());
  }
  return p;
}

}  // namespace cortshift_stereo
