// Effective parameters as text: what ParameterReader reads, written down with the same calls.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

namespace cortshift_stereo {

/// Takes the calls of a ParameterReader. One "key: value" on a line, in the order of the keys; a number as the shortest
/// text that reads back as the same number, so that equal parameters are equal text.
class ParameterWriter {
 public:
  template <typename Number>
  void number(const std::string& key, const Number& value, Number, Number) {
    lines_[key] = text(value);
  }
  void choice(const std::string& key, const std::string& value, const std::vector<std::string>& = {}) {
    lines_[key] = "\"" + value + "\"";
  }
  void flag(const std::string& key, bool value) { lines_[key] = value ? "true" : "false"; }
  void numbers(const std::string& key, const std::vector<double>& values, std::size_t) {
    std::string list;
    for (const double value : values) list += (list.empty() ? "" : ", ") + text(value);
    lines_[key] = "[" + list + "]";
  }
  void texts(const std::string& key, const std::vector<std::string>& values) {
    std::string list;
    for (const std::string& value : values) list += (list.empty() ? "" : ", ") + ("\"" + value + "\"");
    lines_[key] = "[" + list + "]";
  }

  /// Leaves out what does not belong to the result: where files go, how many threads work.
  std::string without(const std::vector<std::string>& keys = {}) const {
    std::map<std::string, std::string> kept = lines_;
    for (const std::string& key : keys) kept.erase(key);
    std::string all;
    for (const auto& [key, value] : kept) all += key + ": " + value + "\n";
    return all;
  }

 private:
  static std::string text(double value) {
    char out[40];
    for (int digits = 1; digits <= 17; ++digits) {
      std::snprintf(out, sizeof out, "%.*g", digits, value);
      if (std::strtod(out, nullptr) == value) break;
    }
    return out;
  }
  static std::string text(int value) { return std::to_string(value); }

  std::map<std::string, std::string> lines_;
};

}  // namespace cortshift_stereo
