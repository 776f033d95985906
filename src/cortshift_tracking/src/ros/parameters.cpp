#include "cortshift_tracking/ros/parameters.hpp"

#include <cmath>
#include <vector>

#include "cortshift_stereo/calibration/hand_eye/hand_eye_yaml.hpp"
#include "cortshift_stereo/calibration/settings/settings_report.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"
#include "cortshift_stereo/ros/parameter_reader.hpp"
#include "cortshift_stereo/ros/parameter_writer.hpp"
#include "cortshift_tracking/case/case_state.hpp"

namespace cortshift_tracking {

namespace {

/// What the parameters give in another form than the struct holds it.
struct Spelt {
  std::vector<double> gravity;
  std::string inversion = "linear", surround = "correct";
  int threads = 0;
};

/// Every parameter once, for reading and for writing down.
template <typename Reader, typename Parameters>
void each(Reader& reader, Parameters& p, Spelt& spelt) {
  reader.choice("case_folder", p.case_folder);
  reader.number("capture_timeout", p.capture_timeout, 0.1, 600.0);
  reader.number("max_surface_age", p.max_surface_age, 0.0, 3600.0);
  reader.number("max_pose_gap", p.max_pose_gap, 0.001, 10.0);
  reader.number("max_speed", p.max_speed, 0.0001, 1.0);
  reader.number("tracker_jitter", p.poses.tracker_jitter, 0.00001, 0.01);
  reader.numbers("gravity", spelt.gravity, 3);
  reader.number("arrow_spacing", p.arrow_spacing, 0.0005, 0.05);

  auto& s = p.shift;
  reader.number("resolution", s.frame.resolution, 0.00005, 0.001);
  reader.number("margin", s.frame.margin, 0.0, 0.02);
  reader.number("max_edge_ratio", s.projection.max_edge_ratio, 2.0, 50.0);
  reader.number("fold_tolerance", s.projection.fold_tolerance, 0.0, 0.01);
  reader.choice("channels", s.matching.channels, {"auto", "rgb", "green", "blue", "luminance"});
  reader.number("detail", s.matching.detail, 0.5, 100.0);
  reader.number("bend", s.matching.bend, 0.01, 1000.0);
  reader.number("search", s.matching.search, 0.001, 0.05);
  reader.number("coarse_resolution", s.matching.coarse_resolution, 0.00005, 0.002);
  reader.number("coarse_rounds", s.matching.coarse_rounds, 0, 10);
  reader.choice("inversion", spelt.inversion, {"linear", "nearest"});
  reader.number("min_confidence", s.inversion.min_confidence, 0.0, 1.0);
  reader.number("border", s.trust.border, 0.0, 0.02);
  reader.number("hole_border", s.trust.hole_border, 0.0, 0.02);
  reader.number("glare", s.trust.glare, 0.5, 1.0);
  reader.number("glare_margin", s.trust.glare_margin, 0.0, 0.01);
  reader.number("match_window", s.trust.agreement.window, 0.0005, 0.02);
  reader.number("image_noise", s.trust.agreement.image_noise, 0.0, 0.2);
  reader.choice("surround", spelt.surround, {"off", "check", "correct"});
  reader.number("pose_translation_sd", s.surround.pose_translation_sd, 0.0, 0.01);
  reader.number("pose_rotation_sd", s.surround.pose_rotation_sd, 0.0, 0.1);
  reader.number("pose_latency_sd", s.surround.pose_latency_sd, 0.0, 1.0);
  reader.choice("hand_eye", p.hand_eye);
  reader.choice("stereo_report", p.stereo_report);
  reader.choice("settings_report", p.settings_report);
  reader.flag("own_points", s.with_own_points);
  reader.flag("strain", s.with_strain);
  reader.number("strain_window", s.strain.window, 0.0005, 0.02);
  reader.choice("exclusions", p.exclusions);
  reader.number("track_resolution", p.track_resolution, 0.00005, 0.001);
  reader.number("threads", spelt.threads, 0, 64);
}

}  // namespace

void ShiftTrackerParameters::readResiduals() {
  const auto from = [](const char* key, const auto& read, const std::string& path) {
    try {
      return read(path);
    } catch (const cortshift_stereo::CalibrationError& error) {
      throw cortshift_stereo::ParameterError("parameter " + std::string(key) + ": " + error.what());
    }
  };
  SurroundSettings& known = shift.surround;
  if (!hand_eye.empty()) {
    const auto deviation = from("hand_eye", cortshift_stereo::readHandEyeDeviation, hand_eye);
    known.calibration.push_back(
        {"hand-eye", "residuals of its calibration file", deviation.translation_sd, deviation.rotation_sd, true});
  }
  if (stereo_report.empty()) {
    if (!settings_report.empty())
      throw cortshift_stereo::ParameterError(
          "parameter settings_report needs stereo_report, which says how long a pixel of disparity is");
    return;
  }
  const auto stereo = from("stereo_report", cortshift_stereo::readStereoResiduals, stereo_report);
  const double pixel = 1 / (stereo.focal_length * stereo.baseline);  // of 1 / depth [1/m]
  known.depths.push_back(
      {"stereo calibration", "held-out residuals of its report", stereo.focal_deviation, stereo.epipolar_rms * pixel});
  if (settings_report.empty()) return;
  const auto zoom = from("settings_report", cortshift_stereo::readSettingsResiduals, settings_report);
  known.zoom = SettingsError{zoom.reference.magnification, zoom.reference.focal_length, zoom.disparity_rms * pixel};
}

std::string ShiftTrackerParameters::effective() const {
  Spelt spelt;
  if (gravity_pmr) spelt.gravity = {gravity_pmr->x(), gravity_pmr->y(), gravity_pmr->z()};
  if (shift.inversion.interpolation == Interpolation::kNearest) spelt.inversion = "nearest";
  if (shift.surround.mode != SurroundMode::kCorrect)
    spelt.surround = shift.surround.mode == SurroundMode::kCheck ? "check" : "off";
  cortshift_stereo::ParameterWriter writer;
  each(writer, *this, spelt);
  return writer.without({"case_folder", "threads"});  // the result does not depend on them
}

std::string ShiftTrackerParameters::configuration(const std::string& reconstruction) const {
  return "# surface_reconstruction\n" + reconstruction + "# shift_tracker\n" + effective();
}

ShiftTrackerParameters ShiftTrackerParameters::load(const cortshift_stereo::ParameterSource& source) {
  ShiftTrackerParameters p;
  cortshift_stereo::ParameterReader reader(source);
  Spelt spelt;
  each(reader, p, spelt);
  reader.finish();
  p.shift.inversion.interpolation = spelt.inversion == "linear" ? Interpolation::kLinear : Interpolation::kNearest;
  p.shift.surround.mode = spelt.surround == "off"     ? SurroundMode::kOff
                          : spelt.surround == "check" ? SurroundMode::kCheck
                                                      : SurroundMode::kCorrect;
  p.readResiduals();
  p.shift.setThreads(spelt.threads);

  if (!spelt.gravity.empty()) {
    p.gravity_pmr = unitVector({spelt.gravity[0], spelt.gravity[1], spelt.gravity[2]});
    if (!p.gravity_pmr)
      throw cortshift_stereo::ParameterError(
          "parameter gravity is not a direction; give three numbers in pmr, for instance [0, -1, 0], or none");
  }
  return p;
}

}  // namespace cortshift_tracking
