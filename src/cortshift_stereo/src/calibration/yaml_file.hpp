// Reading and writing the YAML files of calibrations: every fault names the file and the key.
#pragma once

#include <yaml-cpp/yaml.h>

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// @throws CalibrationError if the file cannot be read or is not YAML with keys and values.
YAML::Node loadYamlFile(const std::string& path);

/// The child of a mapping. @throws CalibrationError if there is none.
YAML::Node requiredNode(const YAML::Node& parent, const std::string& key, const std::string& path);

/// The value of a key. @throws CalibrationError if it is missing or of another type.
template <typename T>
T requiredValue(const YAML::Node& parent, const std::string& key, const std::string& path) {
  const YAML::Node node = requiredNode(parent, key, path);
  try {
    return node.as<T>();
  } catch (const YAML::Exception&) {
    throw CalibrationError(path + ": the value of " + key + " is not of the type that belongs there; write it anew");
  }
}

/// A finite number. @throws CalibrationError if it is missing or not one.
double requiredNumber(const YAML::Node& parent, const std::string& key, const std::string& path);

/// A list of finite numbers. @throws CalibrationError if it is missing or holds anything else.
std::vector<double> requiredNumbers(const YAML::Node& parent, const std::string& key, const std::string& path);

/// The shortest text that reads back as the same double.
std::string exactText(double value);

/// "[a, b, c]", each number exact.
std::string exactText(const std::vector<double>& values);

/// For people: a number with so many digits after the point.
std::string fixedText(double value, int digits = 4);

/// Make a folder and those above it where they are missing.
/// @throws CalibrationError if that cannot be done.
void makeFolder(const std::string& path);

/// Write a whole file or leave the old one as it was.
/// @throws CalibrationError if the folder cannot be written.
void writeTextFile(const std::string& path, const std::string& text);

}  // namespace cortshift_stereo
