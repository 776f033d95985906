#include "cortshift_stereo/calibration/camera_info_yaml.hpp"

#include <cmath>
#include <optional>
#include <sstream>

#include "calibration/yaml_file.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

/// A key by the name of camera_calibration_parsers or by that of the message's field, which `rostopic echo` writes.
struct Found {
  std::string key;
  YAML::Node node;
};

Found findKey(const YAML::Node& root, const std::string& key, const std::string& short_key, const std::string& path) {
  if (root[key] && root[short_key])
    throw CalibrationError(path + ": " + key + " and " + short_key + " are both given; keep one of them");
  const std::string& used = root[short_key] ? short_key : key;
  return {used, requiredNode(root, used, path)};
}

int readCount(const YAML::Node& root, const std::string& key, const std::string& short_key, const std::string& path) {
  return requiredValue<int>(root, findKey(root, key, short_key, path).key, path);
}

/// The numbers of a list, whose entries may be lists in turn (rows).
void appendNumbers(const YAML::Node& node, const std::string& where, std::vector<double>& numbers) {
  if (node.IsSequence()) {
    for (const YAML::Node& entry : node) appendNumbers(entry, where, numbers);
    return;
  }
  double value = 0;
  try {
    value = node.as<double>();
  } catch (const YAML::Exception&) {
    throw CalibrationError(where + " holds something that is not a number; write it anew");
  }
  if (!std::isfinite(value)) throw CalibrationError(where + " holds a number that is not finite; calibrate again");
  numbers.push_back(value);
}

/// Numbers as sites write them: {rows, cols, data}, {data} alone, a flat list, or a list of rows.
struct Numbers {
  std::vector<double> values;
  std::optional<cv::Size> shape;  ///< columns x rows where the file says them
};

Numbers readNumbers(const Found& found, const std::string& path) {
  const std::string where = path + ": " + found.key;
  Numbers numbers;
  YAML::Node data = found.node;
  if (data.IsMap()) {
    data = requiredNode(found.node, "data", where);
    if (found.node["rows"] || found.node["cols"])
      numbers.shape = {requiredValue<int>(found.node, "cols", where), requiredValue<int>(found.node, "rows", where)};
  } else if (data.IsSequence() && data.size() > 0 && data[0].IsSequence()) {
    numbers.shape = {static_cast<int>(data[0].size()), static_cast<int>(data.size())};
  }
  if (!data.IsSequence())
    throw CalibrationError(where + " is neither a list of numbers nor {rows, cols, data}; write it anew");
  appendNumbers(data, where, numbers.values);
  if (numbers.shape && static_cast<std::size_t>(numbers.shape->area()) != numbers.values.size())
    throw CalibrationError(where + " is not " + std::to_string(numbers.shape->height) + "x" +
                           std::to_string(numbers.shape->width) + " with as many numbers (it holds " +
                           std::to_string(numbers.values.size()) + "); calibrate again");
  return numbers;
}

template <int rows, int columns>
cv::Matx<double, rows, columns> readMatrix(const YAML::Node& root, const std::string& key, const std::string& short_key,
                                           const std::string& path) {
  const Found found = findKey(root, key, short_key, path);
  const Numbers numbers = readNumbers(found, path);
  if (numbers.values.size() != std::size_t{rows * columns} ||
      (numbers.shape && *numbers.shape != cv::Size(columns, rows)))
    throw CalibrationError(path + ": " + found.key + " is not " + std::to_string(rows) + "x" + std::to_string(columns) +
                           " with as many numbers; calibrate again");
  return cv::Matx<double, rows, columns>(numbers.values.data());
}

/// What the nodes refuse too: the matrices would be those of other pixels.
void refuseBinningAndRegion(const YAML::Node& root, const std::string& path) {
  for (const char* key : {"binning_x", "binning_y"})
    if (root[key] && requiredValue<int>(root, key, path) > 1)
      throw CalibrationError(path + ": " + key + " is " + std::to_string(requiredValue<int>(root, key, path)) +
                             "; binning is not supported: calibrate on full-resolution images");
  const YAML::Node roi = root["roi"];
  if (!roi || !roi.IsMap()) return;
  for (const char* key : {"x_offset", "y_offset", "width", "height"}) {
    const int value = roi[key] ? requiredValue<int>(roi, key, path + ": roi") : 0;
    const int full = std::string(key) == "width"    ? readCount(root, "image_width", "width", path)
                     : std::string(key) == "height" ? readCount(root, "image_height", "height", path)
                                                    : 0;
    if (value != 0 && value != full)
      throw CalibrationError(path + ": roi: " + key + " is " + std::to_string(value) +
                             "; a region of interest is not supported: calibrate on full images");
  }
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
  camera.model.size = {readCount(root, "image_width", "width", path), readCount(root, "image_height", "height", path)};
  refuseBinningAndRegion(root, path);
  camera.model.K = readMatrix<3, 3>(root, "camera_matrix", "K", path);
  camera.model.lens =
      lensNamed(requiredValue<std::string>(root, "distortion_model", path), path + ": distortion_model");
  const Found terms = findKey(root, "distortion_coefficients", "D", path);
  camera.model.D = checkedCoefficients(camera.model.lens, readNumbers(terms, path).values, path + ": " + terms.key);
  camera.model.R = readMatrix<3, 3>(root, "rectification_matrix", "R", path);
  camera.model.P = readMatrix<3, 4>(root, "projection_matrix", "P", path);
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
  const auto distortion = checkedCoefficients(camera.model.lens, camera.model.D, path + ": distortion_coefficients");
  text << "image_width: " << camera.model.size.width << "\nimage_height: " << camera.model.size.height
       << "\ncamera_name: " << YAML::Dump(YAML::Node(camera.name)) << "\n"
       << matrixText("camera_matrix", camera.model.K) << "distortion_model: " << nameOf(camera.model.lens)
       << "\ndistortion_coefficients:\n  rows: 1\n  cols: " << distortion.size()
       << "\n  data: " << exactText(distortion) << "\n"
       << matrixText("rectification_matrix", camera.model.R) << matrixText("projection_matrix", camera.model.P);
  writeTextFile(path, text.str());
}

}  // namespace cortshift_stereo
