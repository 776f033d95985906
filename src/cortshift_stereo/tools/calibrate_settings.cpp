// Images of fixed boards at many settings of the microscope to the deformation fields that undo the settings.
#include <cstdio>

#include "cortshift_stereo/calibration/settings/setting_views.hpp"
#include "cortshift_stereo/calibration/settings/settings_report.hpp"
#include "cortshift_stereo/calibration/settings/settings_verdict.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"
#include "cortshift_stereo/command_line.hpp"

namespace cortshift_stereo {
namespace {

const char* const kHelp =
    R"(calibrate_settings --manifest M.yaml --output DIR

Find, for each camera, the deformation field that turns an image taken at any magnification and focal length into the
one that the reference setting would have given (Ji et al. 2014, section 2.3).

  --manifest FILE  which image shows the board at which setting (paths relative to the file, focal lengths in metres):

      reference: {magnification: 1.0, focal_length: 0.3}
      boards:
        - board: 9x6                          # inner corners
          reference: {left: a_left.png, right: a_right.png}
          views:
            - {magnification: 0.8, focal_length: 0.25, left: b_left.png, right: b_right.png}
            - ...

  --output DIR     gets settings_left.yaml, settings_right.yaml and settings_report.yaml; made if missing

Put the board at the working distance and let neither it nor the microscope move while its pairs are taken. Take a grid
of settings, at least 3 of one of the two, better 4 or 5 of each. All of a board must be in view; list a small board for
high and a large one for low magnification to cover the whole image. Only settings within the grid can be used later,
and only the part of the reference image that the boards covered.
The fields are of the images themselves, whatever the lens. The last line is the verdict: good, doubtful or useless, and what
to do. Of a useless calibration only the report is written.
Exit: 0 done, 1 failed or useless, 2 bad usage.
)";

void print(const char* side, const SettingsCalibration& calibration) {
  std::printf(
      "%-5s %3zu views, polynomial of degree %d in the image, %d in magnification, %d in focal length: "
      "RMS %.3f px, on held-out settings %.3f px\n",
      side, calibration.residuals.size(), calibration.image_degree, calibration.setting_degrees.first,
      calibration.setting_degrees.second, calibration.rms, calibration.held_out_rms);
  for (const auto& view : calibration.rejected)
    std::printf("%s left out: %s\n", view.name.c_str(), view.reason.c_str());
}

SettingsCalibration calibrateSide(const std::string& side, const SettingViews& found, const SettingsManifest& manifest,
                                  const std::vector<SettingView>& views) {
  try {
    return calibrateSettings(found.size, manifest.reference, views);
  } catch (const CalibrationError& fault) {
    std::string message = "verdict: useless: " + side + " camera: " + fault.what();
    for (const auto& view : found.rejected) message += "\n  " + view.name + ": " + view.reason;
    throw CalibrationError(message);
  }
}

void run(const Options& options) {
  const std::string path = options.required("manifest");
  const std::string output = options.required("output");
  const SettingsManifest manifest = readSettingsManifest(path);
  const SettingViews found = findSettingViews(manifest, progressBar("finding boards"));
  const auto left = calibrateSide("left", found, manifest, found.left);
  const auto right = calibrateSide("right", found, manifest, found.right);
  const CalibrationVerdict verdict = judgeSettings(left, right, found.rejected.size());
  writeSettingsCalibration(output, dateNow(), left, right, found.rejected, verdict);
  for (const auto& view : found.rejected) std::printf("%s left out: %s\n", view.name.c_str(), view.reason.c_str());
  print("left", left);
  print("right", right);
  const bool useless = verdict.grade() == Grade::kUseless;
  std::printf("wrote %ssettings_report.yaml to %s\n%s\n", useless ? "" : "settings_left.yaml, settings_right.yaml and ",
              output.c_str(), verdict.line().c_str());
  if (useless) throw CalibrationError("the calibration is useless");
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  return cortshift_stereo::runTool(argc, argv, cortshift_stereo::kHelp, {"manifest", "output"}, cortshift_stereo::run);
}
