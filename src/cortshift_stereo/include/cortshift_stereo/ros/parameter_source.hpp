// Where parameters come from: a node's private names on the parameter server, or the YAML file that is loaded into
// them.
#pragma once

#include <XmlRpcValue.h>
#include <ros/node_handle.h>

#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace cortshift_stereo {

/// A parameter that is missing, unknown, of the wrong type or out of range. The message names key, value and range.
class ParameterError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class ParameterSource {
 public:
  /// Implicit: a node passes its handle.
  ParameterSource(const ros::NodeHandle& private_node) : node_(private_node) {}  // NOLINT

  /// The parameters of a file as `rosparam load` would set them, without a master.
  /// @throws ParameterError if the file cannot be read or is not a dictionary
  static ParameterSource fromYaml(const std::string& path);

  /// Namespace of the node or path of the file.
  std::string name() const { return node_ ? node_->getNamespace() : path_; }

  bool has(const std::string& key) const { return node_ ? node_->hasParam(key) : values_.hasMember(key); }

  /// Everything that is set, relative to name().
  std::vector<std::string> keys() const;

  /// False where the parameter is of another type. A whole number serves as a real one.
  template <typename T>
  bool get(const std::string& key, T& value) const {
    return node_ ? node_->getParam(key, value) : convert(values_[key], value);
  }

 private:
  ParameterSource(const std::string& path, const XmlRpc::XmlRpcValue& values) : path_(path), values_(values) {}

  static bool convert(const XmlRpc::XmlRpcValue& given, XmlRpc::XmlRpcValue& value);
  static bool convert(const XmlRpc::XmlRpcValue& given, bool& value);
  static bool convert(const XmlRpc::XmlRpcValue& given, int& value);
  static bool convert(const XmlRpc::XmlRpcValue& given, double& value);
  static bool convert(const XmlRpc::XmlRpcValue& given, std::string& value);

  template <typename T>
  static bool convert(const XmlRpc::XmlRpcValue& given, std::vector<T>& value) {
    if (given.getType() != XmlRpc::XmlRpcValue::TypeArray) return false;
    value.resize(static_cast<std::size_t>(given.size()));
    for (int i = 0; i < given.size(); ++i)
      if (!convert(given[i], value[static_cast<std::size_t>(i)])) return false;
    return true;
  }

  std::optional<ros::NodeHandle> node_;
  std::string path_;
  XmlRpc::XmlRpcValue values_;
};

}  // namespace cortshift_stereo
