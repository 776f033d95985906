// Reads parameters into their struct; what is wrong stops the program with a message.
#pragma once

#include <ros/console.h>

#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_stereo/ros/parameter_source.hpp"

namespace cortshift_stereo {

/// Usage: one call per member of the struct (its initial value is the default), then finish().
class ParameterReader {
 public:
  explicit ParameterReader(const ParameterSource& source) : source_(source) {}

  /// A number within [low, high]; the present value of `value` is the default.
  template <typename Number>
  void number(const std::string& key, Number& value, Number low, Number high) {
    optional(key, value);
    if (!(value >= low && value <= high)) fail(key, value, "allowed is " + text(low) + " ... " + text(high));
  }

  /// A text out of `allowed` (empty: any text).
  void choice(const std::string& key, std::string& value, const std::vector<std::string>& allowed = {}) {
    bool flag = false;
    if (source_.has(key) && source_.get(key, flag)) {  // off and on without quotes: YAML makes them false and true
      known_.insert(key);
      value = flag ? "on" : "off";
      log_ << " " << key << "=" << value;
    } else {
      optional(key, value);
    }
    if (allowed.empty()) return;
    std::string list;
    for (const std::string& option : allowed) {
      if (option == value) return;
      list += (list.empty() ? "" : ", ") + option;
    }
    fail(key, value, "allowed is one of " + list);
  }

  void flag(const std::string& key, bool& value) { optional(key, value); }

  /// A list of exactly `size` numbers, or an empty one where the default is empty and nothing is given.
  void numbers(const std::string& key, std::vector<double>& value, std::size_t size) {
    const std::vector<double> standard = value;
    optional(key, value);
    if (value.size() != size && !(standard.empty() && value.empty()))
      fail(key, value, "allowed is a list of " + text(size) + " numbers");
  }

  /// A list of texts.
  void texts(const std::string& key, std::vector<std::string>& value) { optional(key, value); }

  /// A list or dictionary that the caller takes apart; it stays invalid where nothing is given.
  void structure(const std::string& key, XmlRpc::XmlRpcValue& value) {
    known_.insert(key);
    if (source_.has(key)) source_.get(key, value);
    log_ << " " << key << "=" << (value.valid() ? value.toXml() : "none");
  }

  /// A text that must be given.
  void required(const std::string& key, std::string& value) {
    value.clear();
    optional(key, value);
    if (value.empty())
      throw ParameterError("parameter " + name(key) + " is missing; set it in the launch file or config");
  }

  /// Refuses parameters that nobody has read and logs the configuration in force.
  void finish() {
    for (const std::string& key : source_.keys())
      if (known_.count(key) == 0 && known_.count(key.substr(0, key.find('/'))) == 0)
        throw ParameterError("parameter " + name(key) + " is unknown; known are:" + knownNames());
    ROS_INFO_STREAM("configuration of " << source_.name() << ":" << log_.str());
  }

 private:
  template <typename T>
  void optional(const std::string& key, T& value) {
    known_.insert(key);
    if (source_.has(key)) {
      T given{};
      if (!source_.get(key, given))
        throw ParameterError("parameter " + name(key) + " is not of the type of its default (" + text(value) + ")");
      value = given;
    }
    log_ << " " << key << "=" << text(value);
  }

  template <typename T>
  [[noreturn]] void fail(const std::string& key, const T& value, const std::string& allowed) const {
    throw ParameterError("parameter " + name(key) + " = " + text(value) + " is not allowed; " + allowed);
  }

  template <typename T>
  static std::string text(const T& value) {
    std::ostringstream out;
    out << std::boolalpha << value;
    return out.str();
  }
  static std::string text(const std::vector<double>& values) {
    std::string out = "[";
    for (const double v : values) out += (out.size() > 1 ? ", " : "") + text(v);
    return out + "]";
  }
  static std::string text(const std::vector<std::string>& values) {
    std::string out = "[";
    for (const std::string& v : values) out += (out.size() > 1 ? ", " : "") + v;
    return out + "]";
  }

  std::string name(const std::string& key) const { return source_.name() + "/" + key; }
  std::string knownNames() const {
    std::string out;
    for (const std::string& key : known_) out += " " + key;
    return out;
  }

  ParameterSource source_;
  std::set<std::string> known_;
  std::ostringstream log_;
};

}  // namespace cortshift_stereo
