#include "cortshift_stereo/calibration/camera_info_yaml.hpp"

#include <sstream>

#include "calibration/yaml_file.hpp"

namespace cortshift_stereo {
namespace {

constexpr int kPlumbBobTerms = 5;

/// A matrix with its shape beside it, as ROS writes them.
template <int rows, int columns>
cv::Matx<double, rows, columns> readMatrix(const YAML::Node& root, const std::string& key, const std::string& path) {
  const YAML::Node node = requiredNode(root, key, path);
  const auto data = requiredNumbers(node, "data", path + ": " + key);
  if (requiredValue<int>(node, "rows", path + ": " + key) != rows ||
      requiredValue<int>(node, "cols", path + ": " + key) != columns || data.size() != std::size_t{rows * columns})
    throw CalibrationError(path + ": " + key + " is not " + std::to_string(rows) + "x" + std::to_string(columns) +
                           " with as many numbers; calibrate again");
  return cv::Matx<double, rows, columns>(data.data());
}

std::vector<double> readDistortion(const YAML::Node& root, const std::string& path) {
  const auto name = requiredValue<std::string>(root, "distortion_model", path);
  if (name != "plumb_bob")
    throw CalibrationError(path + ": distortion_model is " + name + "; only plumb_bob is supported: calibrate with it");
  const auto terms =
      requiredNumbers(requiredNode(root, "distortion_coefficients", path), "data", path + ": distortion_coefficients");
  if (terms.size() > kPlumbBobTerms)
    throw CalibrationError(path + ": distortion_coefficients holds " + std::to_string(terms.size()) +
                           " numbers; plumb_bob has 5: k1 k2 p1 p2 k3");
  return terms;
}

template <int rows, int columns>
std::string matrixText(const std::string& key, const cv::Matx<double, rows, columns>& matrix) {
  const std::vector<double> data(matrix.val, matrix.val + rows * columns);
  return key + ":\n  rows: " + std::to_string(rows) + "\n  cols: " + std::to_string(columns) +
         "\n  data: " + exactText(data) + "\n";
}

}  // namespace

NamedCamera readCameraInfoYaml(const std::string& path) {
  const YAML::Node root = loadYamlFile(path);
  NamedCamera camera;
  if (root["camera_name"]) camera.name = requiredValue<std::string>(root, "camera_name", path);
  camera.model.size = {requiredValue<int>(root, "image_width", path), requiredValue<int>(root, "image_height", path)};
  camera.model.K = readMatrix<3, 3>(root, "camera_matrix", path);
  camera.model.D = readDistortion(root, path);
  camera.model.R = readMatrix<3, 3>(root, "rectification_matrix", path);
  camera.model.P = readMatrix<3, 4>(root, "projection_matrix", path);
  return camera;
}

StereoModel readStereoModelYaml(const std::string& left_path, const std::string& right_path) {
  StereoModel model{readCameraInfoYaml(left_path).model, readCameraInfoYaml(right_path).model};
  try {
    model.validate();
  } catch (const CalibrationError& fault) {
    throw CalibrationError(left_path + " and " + right_path + ": " + fault.what());
  }
  return model;
}

void writeCameraInfoYaml(const std::string& path, const NamedCamera& camera, const std::string& remarks) {
  std::ostringstream text;
  std::istringstream lines(remarks);
  for (std::string line; std::getline(lines, line);) text << "# " << line << "\n";
  std::vector<double> distortion = camera.model.D;
  distortion.resize(kPlumbBobTerms, 0.0);
  text << "image_width: " << camera.model.size.width << "\nimage_height: " << camera.model.size.height
       << "\ncamera_name: " << YAML::Dump(YAML::Node(camera.name)) << "\n"
       << matrixText("camera_matrix", camera.model.K) << "distortion_model: plumb_bob\n"
       << "distortion_coefficients:\n  rows: 1\n  cols: " << kPlumbBobTerms << "\n  data: " << exactText(distortion)
       << "\n"
       << matrixText("rectification_matrix", camera.model.R) << matrixText("projection_matrix", camera.model.P);
  writeTextFile(path, text.str());
}

}  // namespace cortshift_stereo
