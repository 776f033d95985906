#include "cortshift_stereo/calibration/settings/settings_report.hpp"

#include <cmath>
#include <filesystem>

#include "calibration/yaml_file.hpp"

namespace cortshift_stereo {
namespace {

std::string sideText(const std::string& side, const SettingsCalibration& calibration) {
  std::string text = side + ":\n  degree_in_image: " + std::to_string(calibration.image_degree) +
                     "\n  degree_in_magnification: " + std::to_string(calibration.setting_degrees.first) +
                     "\n  degree_in_focal_length: " + std::to_string(calibration.setting_degrees.second) +
                     "\n  rms_px: " + fixedText(calibration.rms) +
                     "\n  held_out_rms_px: " + fixedText(calibration.held_out_rms) + "\n  views:\n";
  for (const auto& view : calibration.residuals)
    text += "    - {image: " + YAML::Dump(YAML::Node(view.name)) +
            ", magnification: " + exactText(view.setting.magnification) +
            ", focal_length: " + exactText(view.setting.focal_length) + ", rms_px: " + fixedText(view.rms) +
            ", held_out_px: " + (std::isnan(view.held_out) ? ".nan" : fixedText(view.held_out)) + "}\n";
  return text;
}

}  // namespace

void writeSettingsCalibration(const std::string& folder, const std::string& date, const SettingsCalibration& left,
                              const SettingsCalibration& right, const std::vector<RejectedView>& rejected,
                              const CalibrationVerdict& verdict) {
  makeFolder(folder);
  const std::filesystem::path place(folder);
  const auto remarks = [&](const std::string& side, const SettingsCalibration& calibration) {
    return verdict.line() + "\nDeformation field of the " + side + " camera, " + date + ", from " +
           std::to_string(calibration.residuals.size()) + " views: RMS " + fixedText(calibration.rms) +
           " px, on held-out settings " + fixedText(calibration.held_out_rms) +
           " px.\nRight in the plane of the board; elsewhere too if the entrance pupil does not move with the "
           "settings.";
  };
  if (verdict.grade() != Grade::kUseless) {
    writeSettingsWarp((place / "settings_left.yaml").string(), left.warp, remarks("left", left));
    writeSettingsWarp((place / "settings_right.yaml").string(), right.warp, remarks("right", right));
  }
  std::string text = std::string(
                         "# Deformation fields from any setting to the reference. rms_px is in the view's own image,\n"
                         "# held_out_px in pixels of the reference image, fitted without that setting (.nan where the\n"
                         "# setting is a corner of the calibrated range, which no others surround).\n") +
                     verdict.yaml() + "date: " + date +
                     "\nreference: {magnification: " + exactText(left.warp.model().reference.magnification) +
                     ", focal_length: " + exactText(left.warp.model().reference.focal_length) + "}\n" +
                     sideText("left", left) + sideText("right", right);
  std::vector<RejectedView> all = rejected;
  all.insert(all.end(), left.rejected.begin(), left.rejected.end());
  all.insert(all.end(), right.rejected.begin(), right.rejected.end());
  text += std::string("rejected:") + (all.empty() ? " []" : "") + "\n";
  for (const auto& view : all)
    text += "  - {image: " + YAML::Dump(YAML::Node(view.name)) + ", reason: \"" + view.reason + "\"}\n";
  writeTextFile((place / "settings_report.yaml").string(), text);
}

SettingsResiduals readSettingsResiduals(const std::string& path) {
  const YAML::Node root = loadYamlFile(path);
  const YAML::Node reference = requiredNode(root, "reference", path);
  SettingsResiduals residuals;
  residuals.reference = {requiredNumber(reference, "magnification", path),
                         requiredNumber(reference, "focal_length", path)};
  double squares = 0;
  for (const char* side : {"left", "right"}) {
    const double rms = requiredNumber(requiredNode(root, side, path), "held_out_rms_px", path);
    squares += rms * rms / 2;  // lengths in the image: half of it is along the rows
  }
  residuals.disparity_rms = std::sqrt(squares);
  return residuals;
}

}  // namespace cortshift_stereo
