#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <sstream>

#include "calibration/yaml_file.hpp"
#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kMillimetre = 1e-3;

/// Of metres. A product rounds 0.0042 m to 4.2 mm, a quotient does not.
double millimetres(double metres) { return 1e3 * metres; }

std::string errorsText(const SetErrors& errors, const std::string& indent) {
  return indent + "reprojection_rms_px: " + fixedText(errors.reprojection_rms, 4) + "\n" + indent +
         "epipolar_rms_px: " + fixedText(errors.epipolar_rms, 4) + "\n" + indent +
         "corner_spacing_error_mm: " + fixedText(millimetres(errors.spacing_error), 4) + "\n";
}

std::string pairsText(const SetErrors& errors, const std::string& indent) {
  std::string text = indent + "views:\n";
  for (const auto& pair : errors.pairs)
    text += indent + "  - {name: \"" + pair.name + "\", reprojection_rms_px: " + fixedText(pair.rms, 4) +
            ", left_rms_px: " + fixedText(pair.left_rms, 4) + ", right_rms_px: " + fixedText(pair.right_rms, 4) +
            ", epipolar_rms_px: " + fixedText(pair.epipolar_rms, 4) +
            ", corner_spacing_error_mm: " + fixedText(millimetres(pair.spacing_error), 4) + "}\n";
  return text;
}

const DistortionScore& chosenScore(const StereoCalibration& calibration) {
  for (const auto& score : calibration.scores)
    if (score.model == calibration.model) return score;
  return calibration.scores.front();
}

/// The paper's eleven numbers of Eq. 1 per camera and pair: f, S_x, k1, Cx, Cy, and the pose.
std::string cameraText(const std::string& side, const cv::Matx33d& K, LensModel lens, const std::vector<double>& D) {
  std::string terms = termsOf(lens);
  std::replace(terms.begin(), terms.end(), ' ', '_');
  return side + ": {focal_length_px: " + exactText(K(1, 1)) + ", aspect_fx_over_fy: " + exactText(K(0, 0) / K(1, 1)) +
         ", cx_px: " + exactText(K(0, 2)) + ", cy_px: " + exactText(K(1, 2)) + ", distortion_" + terms + ": " +
         exactText(D) + "}\n";
}

}  // namespace

std::string dateNow() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

std::string reportText(const StereoReport& report) {
  const auto& calibration = report.calibration;
  const auto& parameters = calibration.parameters;
  cv::Vec3d turn;
  cv::Rodrigues(parameters.R_right_left, turn);
  const double to_degrees = 180 / CV_PI;
  std::ostringstream text;
  text << "# Calibration of the stereo head. Held-out errors are of views that took no part in the fit that they\n"
          "# check; the board's pose is fitted to both images of a view at once. Distances between points are\n"
          "# root mean squares; corner_spacing_error is the mean |distance of neighbouring corners - square|.\n"
       << report.verdict.yaml() << "date: " << report.date << "\nimages: " << YAML::Dump(YAML::Node(report.images))
       << "\n"
       << "board: {inner_corners: " << report.board.name()
       << ", square_mm: " << exactText(millimetres(report.board.square)) << "}\n"
       << "image_size_px: [" << parameters.size.width << ", " << parameters.size.height << "]\n"
       << cameraText("left", parameters.K_left, parameters.lens, parameters.D_left)
       << cameraText("right", parameters.K_right, parameters.lens, parameters.D_right)
       << "left_in_right: {rotation_vector_deg: "
       << exactText({turn[0] * to_degrees, turn[1] * to_degrees, turn[2] * to_degrees}) << ", translation_mm: "
       << exactText({millimetres(parameters.t_right_left[0]), millimetres(parameters.t_right_left[1]),
                     millimetres(parameters.t_right_left[2])})
       << "}\n"
       << "baseline_mm: " << fixedText(millimetres(cv::norm(parameters.t_right_left)), 4) << "\n"
       << "focal_length_deviation_percent: " << fixedText(100 * calibration.focal_deviation, 3) << "\n"
       << "lens: " << nameOf(parameters.lens)
       << "\nreprojection_rms_alone_px: {left: " << fixedText(calibration.left_alone_rms, 4)
       << ", right: " << fixedText(calibration.right_alone_rms, 4) << "}  # each camera without the other\n"
       << "reach: " << fixedText(calibration.reach, 2) << "  # of the corners, towards the worst corner of the image\n"
       << "board_distance_mm: " << fixedText(millimetres(calibration.distance), 1) << "\n"
       << "distortion_model: " << calibration.model
       << "  # fewest terms within 1 % of the lowest cross-validated reprojection error\n"
       << "cross_validation:\n";
  for (const auto& score : calibration.scores)
    text << "  - model: " << score.model << "\n" << errorsText(score.held_out, "    ");
  text << "held_out_in_turn:  # cross-validation of the chosen model\n"
       << pairsText(chosenScore(calibration).held_out, "  ") << "used:\n"
       << errorsText(calibration.used, "  ") << pairsText(calibration.used, "  ");
  if (report.checks)
    text << "checked:  # views kept out on purpose\n"
         << errorsText(*report.checks, "  ") << pairsText(*report.checks, "  ");
  text << "rejected:" << (calibration.rejected.empty() ? " []" : "") << "\n";
  for (const auto& view : calibration.rejected)
    text << "  - {name: \"" << view.name << "\", reason: \"" << view.reason << "\"}\n";
  return text.str();
}

std::string remarksText(const StereoReport& report) {
  const auto& held_out = chosenScore(report.calibration).held_out;
  return report.verdict.line() + "\nCalibrated " + report.date + " from " +
         std::to_string(report.calibration.used.pairs.size()) + " views of a " + report.board.name() +
         " board with squares of " + exactText(millimetres(report.board.square)) +
         " mm.\nLens: " + nameOf(report.calibration.parameters.lens) + ", terms " + report.calibration.model +
         ". Reprojection RMS " + fixedText(report.calibration.used.reprojection_rms, 3) + " px, on held-out views " +
         fixedText(held_out.reprojection_rms, 3) + " px, epipolar " + fixedText(held_out.epipolar_rms, 3) + " px.";
}

void writeStereoCalibration(const std::string& folder, const StereoReport& report) {
  const StereoModel model = rectify(report.calibration.parameters);
  makeFolder(folder);
  const std::filesystem::path place(folder);
  const std::string remarks = remarksText(report);
  if (report.verdict.grade() != Grade::kUseless) {
    writeCameraInfoYaml((place / "left.yaml").string(), {"left", model.left}, remarks);
    writeCameraInfoYaml((place / "right.yaml").string(), {"right", model.right}, remarks);
  }
  writeTextFile((place / "report.yaml").string(), reportText(report));
}

StereoResiduals readStereoResiduals(const std::string& path) {
  const YAML::Node root = loadYamlFile(path);
  StereoResiduals residuals;
  residuals.focal_deviation = requiredNumber(root, "focal_length_deviation_percent", path) / 100;
  residuals.baseline = kMillimetre * requiredNumber(root, "baseline_mm", path);
  residuals.focal_length = requiredNumber(requiredNode(root, "left", path), "focal_length_px", path);
  const auto chosen = requiredValue<std::string>(root, "distortion_model", path);
  residuals.epipolar_rms = -1;
  for (const YAML::Node& score : requiredNode(root, "cross_validation", path))
    if (requiredValue<std::string>(score, "model", path) == chosen)
      residuals.epipolar_rms = requiredNumber(score, "epipolar_rms_px", path);
  if (!(residuals.epipolar_rms >= 0 && residuals.focal_deviation >= 0 && residuals.baseline > 0 &&
        residuals.focal_length > 0))
    throw CalibrationError(path +
                           ": it is no report of calibrate_stereo (focal length and baseline above 0, and the "
                           "epipolar_rms_px of the chosen model); calibrate again");
  return residuals;
}

}  // namespace cortshift_stereo
