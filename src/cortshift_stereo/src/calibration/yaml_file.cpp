#include "calibration/yaml_file.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "cortshift_stereo/durable_file.hpp"

namespace cortshift_stereo {

YAML::Node loadYamlFile(const std::string& path) {
  if (!std::filesystem::is_regular_file(path))
    throw CalibrationError(path + ": no such file; give the path of a calibration file");
  YAML::Node root;
  try {
    root = YAML::LoadFile(path);
  } catch (const YAML::Exception& fault) {
    throw CalibrationError(path + ": not readable as YAML (" + fault.what() + "); write it anew");
  }
  if (!root.IsMap()) throw CalibrationError(path + ": holds no keys and values; it is not a calibration file");
  return root;
}

YAML::Node requiredNode(const YAML::Node& parent, const std::string& key, const std::string& path) {
  if (!parent.IsMap() || !parent[key])
    throw CalibrationError(path + ": " + key + " is missing; add it or calibrate again");
  return parent[key];
}

double requiredNumber(const YAML::Node& parent, const std::string& key, const std::string& path) {
  const double value = requiredValue<double>(parent, key, path);
  if (!std::isfinite(value)) throw CalibrationError(path + ": " + key + " is not a finite number; calibrate again");
  return value;
}

std::vector<double> requiredNumbers(const YAML::Node& parent, const std::string& key, const std::string& path) {
  auto values = requiredValue<std::vector<double>>(parent, key, path);
  for (const double value : values)
    if (!std::isfinite(value))
      throw CalibrationError(path + ": " + key + " holds a number that is not finite; calibrate again");
  return values;
}

std::string exactText(double value) {
  char text[32];
  for (const int digits : {15, 16, 17}) {
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    if (std::strtod(text, nullptr) == value) break;
  }
  return text;
}

std::string exactText(const std::vector<double>& values) {
  std::string text = "[";
  for (std::size_t i = 0; i < values.size(); ++i) text += (i ? ", " : "") + exactText(values[i]);
  return text + "]";
}

std::string fixedText(double value, int digits) {
  std::ostringstream text;
  text.precision(digits);
  text << std::fixed << value;
  return text.str();
}

void makeFolder(const std::string& path) {
  std::error_code fault;
  std::filesystem::create_directories(path, fault);
  if (fault) throw CalibrationError(path + ": cannot be made (" + fault.message() + "); give another folder");
}

void writeTextFile(const std::string& path, const std::string& text) try {
  replaceDurably(path, text.data(), text.size());
} catch (const FileError& error) {
  throw CalibrationError(error.what());
}

}  // namespace cortshift_stereo
