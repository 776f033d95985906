#include "cortshift_stereo/calibration/hand_eye/hand_eye_yaml.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "calibration/rigid.hpp"
#include "calibration/yaml_file.hpp"

namespace cortshift_stereo {
namespace {

const char* const kParent = "microscope";
const char* const kChild = "left_optical";
constexpr double kMillimetre = 1e-3;
constexpr double kDegree = CV_PI / 180;

std::string rounded(double value) {
  std::ostringstream text;
  text.precision(4);
  text << value;
  return text.str();
}

std::string rounded(const cv::Vec3d& values, double unit) {
  return "[" + rounded(values[0] / unit) + ", " + rounded(values[1] / unit) + ", " + rounded(values[2] / unit) + "]";
}

template <typename Vector>
std::vector<double> listOf(const Vector& values) {
  return {values.val, values.val + Vector::channels};
}

}  // namespace

void writeHandEyeYaml(const std::string& path, const HandEyeReport& report) {
  const auto& calibration = report.calibration;
  const auto& pose = calibration.T_microscope_left;
  std::ostringstream text;
  text << "# Pose of the left camera in the microscope's tracked body (metres, unit quaternion x y z w).\n"
       << report.verdict.yaml() << "date: " << report.date << "\nimages: " << YAML::Dump(YAML::Node(report.images))
       << "\ncamera: " << YAML::Dump(YAML::Node(report.camera)) << "\nboard: {inner_corners: " << report.board.name()
       << ", square_mm: " << exactText(1e3 * report.board.square) << "}\n"
       << "parent_frame: " << kParent << "\nchild_frame: " << kChild << "\n"
       << "translation: " << exactText(listOf(pose.translation())) << "\n"
       << "rotation: " << exactText(listOf(quaternionFromRotation(pose.rotation()))) << "\n"
       << "# Standard deviations along and about the camera's axes, from the residuals.\n"
       << "translation_deviation_mm: " << rounded(calibration.position_sd, kMillimetre) << "\n"
       << "rotation_deviation_deg: " << rounded(calibration.rotation_sd, kDegree) << "\n"
       << "# Root mean square rotation of the microscope about its principal axes; at least "
       << rounded(kLeastRotationDiversity / kDegree) << " about the second.\n"
       << "rotation_diversity_deg: " << rounded(calibration.rotation_diversity, kDegree) << "\n"
       << "tracker_assumed: {position_sd_mm: " << rounded(report.settings.tracker_position_sd / kMillimetre)
       << ", rotation_sd_deg: " << rounded(report.settings.tracker_rotation_sd / kDegree) << "}\n"
       << "misfit: " << rounded(calibration.misfit)
       << "  # RMS correction of a tracked pose in the tracker's deviations\n"
       << "reprojection_rms_px: " << rounded(calibration.reprojection_rms) << "  # with the tracked poses as they are\n"
       << "method_spread_mm: " << rounded(calibration.method_spread / kMillimetre) << "\n"
       << "methods:  # closed-form solutions, compared with the refined one\n";
  for (const auto& method : calibration.methods)
    text << "  - {name: " << method.method
         << ", translation_difference_mm: " << rounded(method.translation_difference / kMillimetre)
         << ", rotation_difference_deg: " << rounded(method.rotation_difference / kDegree) << "}\n";
  text << "views:\n";
  for (const auto& view : calibration.residuals)
    text << "  - {name: " << YAML::Dump(YAML::Node(view.name))
         << ", reprojection_rms_px: " << rounded(view.reprojection_rms)
         << ", position_residual_mm: " << rounded(view.position_residual / kMillimetre)
         << ", rotation_residual_deg: " << rounded(view.rotation_residual / kDegree) << "}\n";
  text << "rejected:" << (calibration.rejected.empty() ? " []" : "") << "\n";
  for (const auto& view : calibration.rejected)
    text << "  - {name: " << YAML::Dump(YAML::Node(view.name)) << ", reason: \"" << view.reason << "\"}\n";
  writeTextFile(path, text.str());
}

cv::Affine3d readHandEyeYaml(const std::string& path) {
  const YAML::Node root = loadYamlFile(path);
  const auto parent = requiredValue<std::string>(root, "parent_frame", path);
  const auto child = requiredValue<std::string>(root, "child_frame", path);
  if (parent != kParent || child != kChild)
    throw CalibrationError(path + ": it is the pose of " + child + " in " + parent + "; wanted is that of " + kChild +
                           " in " + kParent);
  const auto translation = requiredNumbers(root, "translation", path);
  const auto quaternion = requiredNumbers(root, "rotation", path);
  if (translation.size() != 3 || quaternion.size() != 4)
    throw CalibrationError(path + ": translation needs 3 numbers and rotation 4 (x y z w); calibrate again");
  const auto rotation = rotationFromQuaternion(cv::Vec4d(quaternion.data()));
  if (!rotation) throw CalibrationError(path + ": rotation is not a unit quaternion; calibrate again");
  return {*rotation, cv::Vec3d(translation.data())};
}

HandEyeDeviation readHandEyeDeviation(const std::string& path) {
  const YAML::Node root = loadYamlFile(path);
  const auto over_axes = [&](const char* key, double unit) {
    const auto values = requiredNumbers(root, key, path);
    if (values.size() != 3 || *std::min_element(values.begin(), values.end()) < 0)
      throw CalibrationError(path + ": " + key + " needs 3 numbers, none below 0; calibrate again");
    return unit * cv::norm(cv::Vec3d(values.data())) / std::sqrt(3.0);
  };
  return {over_axes("translation_deviation_mm", kMillimetre), over_axes("rotation_deviation_deg", kDegree)};
}

}  // namespace cortshift_stereo
