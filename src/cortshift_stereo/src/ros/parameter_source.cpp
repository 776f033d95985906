#include "cortshift_stereo/ros/parameter_source.hpp"

#include <yaml-cpp/yaml.h>

#include <cstdlib>

namespace cortshift_stereo {
namespace {

using XmlRpc::XmlRpcValue;

XmlRpcValue scalar(const YAML::Node& node) {
  const std::string& text = node.Scalar();
  if (node.Tag() == "!") return XmlRpcValue(text);  // in quotes
  bool flag = false;
  if (YAML::convert<bool>::decode(node, flag)) return XmlRpcValue(flag);
  char* end = nullptr;
  const long whole = std::strtol(text.c_str(), &end, 10);
  if (!text.empty() && *end == '\0') return XmlRpcValue(static_cast<int>(whole));
  const double number = std::strtod(text.c_str(), &end);
  if (!text.empty() && *end == '\0') return XmlRpcValue(number);
  return XmlRpcValue(text);
}

XmlRpcValue valueOf(const YAML::Node& node) {
  XmlRpcValue value;
  if (node.IsScalar()) return scalar(node);
  if (node.IsSequence()) {
    value.setSize(static_cast<int>(node.size()));
    for (std::size_t i = 0; i < node.size(); ++i) value[static_cast<int>(i)] = valueOf(node[i]);
  }
  if (node.IsMap())
    for (const auto& entry : node) value[entry.first.Scalar()] = valueOf(entry.second);
  return value;
}

template <typename T>
bool take(const XmlRpcValue& given, XmlRpcValue::Type type, T& value) {
  if (given.getType() != type) return false;
  value = static_cast<const T&>(given);
  return true;
}

}  // namespace

ParameterSource ParameterSource::fromYaml(const std::string& path) {
  try {
    const YAML::Node root = YAML::LoadFile(path);
    if (!root.IsMap() && !root.IsNull()) throw ParameterError(path + ": not a dictionary of parameters");
    XmlRpcValue values = valueOf(root);
    if (!values.valid()) values.begin();  // an empty file: an empty dictionary
    return {path, values};
  } catch (const YAML::Exception& error) {
    throw ParameterError(path + " cannot be read as parameters: " + error.what());
  }
}

std::vector<std::string> ParameterSource::keys() const {
  std::vector<std::string> keys;
  if (!node_) {
    XmlRpcValue values = values_;
    for (const auto& entry : values) keys.push_back(entry.first);
    return keys;
  }
  std::vector<std::string> names;
  node_->getParamNames(names);
  const std::string prefix = node_->getNamespace() + "/";
  for (const std::string& full : names)
    if (full.compare(0, prefix.size(), prefix) == 0) keys.push_back(full.substr(prefix.size()));
  return keys;
}

bool ParameterSource::convert(const XmlRpcValue& given, XmlRpcValue& value) {
  value = given;
  return true;
}

bool ParameterSource::convert(const XmlRpcValue& given, bool& value) {
  return take(given, XmlRpcValue::TypeBoolean, value);
}

bool ParameterSource::convert(const XmlRpcValue& given, int& value) { return take(given, XmlRpcValue::TypeInt, value); }

bool ParameterSource::convert(const XmlRpcValue& given, double& value) {
  int whole = 0;
  if (!take(given, XmlRpcValue::TypeInt, whole)) return take(given, XmlRpcValue::TypeDouble, value);
  value = whole;
  return true;
}

bool ParameterSource::convert(const XmlRpcValue& given, std::string& value) {
  return take(given, XmlRpcValue::TypeString, value);
}

}  // namespace cortshift_stereo
