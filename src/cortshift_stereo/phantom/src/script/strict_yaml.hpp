// A YAML mapping whose every key must be known, typed and in range. Messages name the full path of a key.
#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <functional>
#include <set>
#include <sstream>
#include <string>

#include "cortshift_stereo_phantom/phantom_case.hpp"

namespace cortshift_stereo_phantom {

class StrictMap {
 public:
  StrictMap(const YAML::Node& node, std::string path) : node_(node), path_(std::move(path)) {
    if (!node_.IsMap()) throw PhantomCaseError(path_ + ": expected a mapping of keys to values");
  }

  bool has(const std::string& key) const { return static_cast<bool>(node_[key]); }
  const std::string& path() const { return path_; }

  /// Reads `key` where it is given; the present value is the default.
  template <typename T>
  void get(const std::string& key, T& value) {
    known_.insert(key);
    if (has(key)) value = as<T>(node_[key], pathOf(key));
  }

  template <int N>
  void get(const std::string& key, Eigen::Matrix<double, N, 1>& value) {
    known_.insert(key);
    if (has(key)) readList(key, value.data(), N);
  }

  template <std::size_t N>
  void get(const std::string& key, std::array<double, N>& value) {
    known_.insert(key);
    if (has(key)) readList(key, value.data(), N);
  }

  template <typename T>
  void require(const std::string& key, T& value) {
    if (!has(key)) throw PhantomCaseError(pathOf(key) + " is missing");
    get(key, value);
  }

  /// Reads a nested mapping where it is given.
  void section(const std::string& key, const std::function<void(StrictMap&)>& read) {
    known_.insert(key);
    if (!has(key)) return;
    StrictMap map(node_[key], pathOf(key));
    read(map);
    map.finish();
  }

  /// Reads a list of mappings where it is given.
  void list(const std::string& key, const std::function<void(StrictMap&)>& read) {
    known_.insert(key);
    if (!has(key)) return;
    if (!node_[key].IsSequence()) throw PhantomCaseError(pathOf(key) + ": expected a list");
    for (std::size_t i = 0; i < node_[key].size(); ++i) {
      StrictMap map(node_[key][i], pathOf(key) + "[" + std::to_string(i) + "]");
      read(map);
      map.finish();
    }
  }

  /// @throws PhantomCaseError naming keys that nothing has read.
  void finish() const {
    for (const auto& entry : node_) {
      const auto key = entry.first.as<std::string>();
      if (known_.count(key)) continue;
      std::string names;
      for (const std::string& name : known_) names += " " + name;
      throw PhantomCaseError(pathOf(key) + " is unknown; known here are:" + names);
    }
  }

 private:
  std::string pathOf(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }

  template <typename T>
  static T as(const YAML::Node& node, const std::string& path) {
    try {
      return node.as<T>();
    } catch (const YAML::Exception&) {
      std::ostringstream text;
      text << node;
      throw PhantomCaseError(path + " = " + text.str() + " is not of the right type");
    }
  }

  void readList(const std::string& key, double* out, std::size_t size) const {
    const YAML::Node list = node_[key];
    if (!list.IsSequence() || list.size() != size)
      throw PhantomCaseError(pathOf(key) + ": expected a list of " + std::to_string(size) + " numbers");
    for (std::size_t i = 0; i < size; ++i) out[i] = as<double>(list[i], pathOf(key));
  }

  YAML::Node node_;
  std::string path_;
  std::set<std::string> known_;
};

}  // namespace cortshift_stereo_phantom
