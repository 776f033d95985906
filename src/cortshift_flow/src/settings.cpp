#include <fstream>
#include <opencv2/core.hpp>
#include <sstream>
#include <stdexcept>

#include "cortshift_flow/flow.hpp"
#include "cortshift_flow/range.hpp"

namespace cortshift_flow {
namespace {

/// One numeric setting: where it is kept and what it may be.
struct Entry {
  const char* name;
  int FlowSettings::*integer;
  double FlowSettings::*real;
  double low, high;
};

const std::vector<Entry>& entries() {
  static const std::vector<Entry> all = {
      {"threads", &FlowSettings::threads, nullptr, 0, 256},
      {"alpha", nullptr, &FlowSettings::alpha, 1e-6, 100},
      {"epsilon", nullptr, &FlowSettings::epsilon, 1e-6, 1},
      {"outer_iterations", &FlowSettings::outer_iterations, nullptr, 1, 100},
      {"inner_iterations", &FlowSettings::inner_iterations, nullptr, 1, 100},
      {"solver_iterations", &FlowSettings::solver_iterations, nullptr, 1, 1000},
      {"presmoothing", nullptr, &FlowSettings::presmoothing, 0, 5},
      {"curvature", nullptr, &FlowSettings::curvature, 1e-6, 10},
      {"coarse_polish_iterations", &FlowSettings::coarse_polish_iterations, nullptr, 0, 100},
      {"full_polish_iterations", &FlowSettings::full_polish_iterations, nullptr, 1, 100},
      {"finest_level", &FlowSettings::finest_level, nullptr, 0, 2},
      {"judge", &FlowSettings::judge, nullptr, 0, 1},
      {"most_unsure", nullptr, &FlowSettings::most_unsure, 0, 1},
      {"search_range", nullptr, &FlowSettings::search_range, 0.01, 0.5},
  };
  return all;
}

double valueOf(const FlowSettings& settings, const Entry& entry) {
  return entry.integer ? settings.*entry.integer : settings.*entry.real;
}

void readEntry(const cv::FileNode& node, const Entry& entry, FlowSettings& settings) {
  if (entry.integer) {
    if (!node.isInt()) throw std::invalid_argument(std::string(entry.name) + " is not a whole number");
    settings.*entry.integer = static_cast<int>(node);
    return;
  }
  if (!node.isInt() && !node.isReal()) throw std::invalid_argument(std::string(entry.name) + " is not a number");
  settings.*entry.real = static_cast<double>(node);
}

void readKey(const cv::FileNode& node, FlowSettings& settings) {
  if (node.name() == "preset") return;
  for (const Entry& entry : entries())
    if (node.name() == entry.name) {
      readEntry(node, entry, settings);
      return;
    }
  std::string known = "preset";
  for (const Entry& entry : entries()) known += std::string(", ") + entry.name;
  throw std::invalid_argument("unknown setting '" + node.name() + "'; known are " + known);
}

}  // namespace

std::vector<std::string> FlowSettings::presetNames() { return {"default", "fast", "ji2014"}; }

FlowSettings FlowSettings::preset(const std::string& name) {
  FlowSettings settings;
  if (name == "default") return settings;
  if (name == "fast") {
    settings.finest_level = 1;
    settings.judge = 0;  // its weights were fitted at full resolution
    settings.coarse_polish_iterations = 2;
    return settings;
  }
  if (name == "ji2014") {
    settings.method = Method::kVariational;
    settings.alpha = 0.02;
    settings.outer_iterations = 3;
    settings.presmoothing = 0.5;
    return settings;
  }
  std::string known;
  for (const std::string& preset : presetNames()) known += (known.empty() ? "" : ", ") + preset;
  throw std::invalid_argument("preset = '" + name + "' is not allowed; allowed is one of " + known);
}

void FlowSettings::validate() const {
  for (const Entry& entry : entries()) requireRange(entry.name, valueOf(*this, entry), entry.low, entry.high);
}

FlowSettings readSettings(const std::string& path) {
  std::ifstream stream(path);
  std::stringstream text;
  if (!stream || !(text << stream.rdbuf())) throw std::runtime_error("cannot read settings from " + path);
  // OpenCV's reader insists on a directive that people do not write.
  const std::string content = text.str().rfind("%YAML", 0) == 0 ? text.str() : "%YAML:1.0\n---\n" + text.str();
  cv::FileStorage file;
  try {
    file.open(content, cv::FileStorage::READ | cv::FileStorage::MEMORY | cv::FileStorage::FORMAT_YAML);
  } catch (const cv::Exception& error) {
    throw std::invalid_argument(path + " is not YAML: " + error.err);
  }
  if (!file.isOpened()) throw std::invalid_argument(path + " is not YAML");
  const cv::FileNode root = file.root();
  try {
    FlowSettings settings;
    if (!root.empty() && !root.isMap()) throw std::invalid_argument("keys and values are expected");
    const cv::FileNode preset = root["preset"];
    if (!preset.empty()) {
      if (!preset.isString()) throw std::invalid_argument("preset is not a name");
      settings = FlowSettings::preset(static_cast<std::string>(preset));
    }
    for (const cv::FileNode& node : root) readKey(node, settings);
    settings.validate();
    return settings;
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(path + ": " + error.what());
  }
}

}  // namespace cortshift_flow
