#include "cortshift_tracking/offline/case_plan.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>
#include <stdexcept>

#include "cortshift_stereo/averaging/frame_collector.hpp"
#include "cortshift_tracking/case/case_state.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

double numberIn(const std::string& text, const std::string& what) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !std::isfinite(value)) throw PlanError(what + ": '" + text + "' is not a number");
  return value;
}

unsigned int pairsIn(const std::string& text, const std::string& what) {
  constexpr auto kMost = cortshift_stereo::FrameCollector::kMostFrames;
  const double value = numberIn(text, what);
  if (!(value >= 1 && value <= static_cast<double>(kMost) && value == std::floor(value)))
    throw PlanError(what + ": a mean of '" + text + "' pairs is not possible; allowed is 1 to " +
                    std::to_string(kMost));
  return static_cast<unsigned int>(value);
}

void requireKeyIn(const std::string& key, const std::string& what) {
  try {
    requireKeyOfCapture(key);
  } catch (const TrackingError& error) {
    throw PlanError(what + ": " + error.what());
  }
}

Eigen::Vector3d direction(const std::vector<double>& values, const std::string& what) {
  if (values.size() == 3)
    if (const auto unit = unitVector({values[0], values[1], values[2]})) return *unit;
  throw PlanError(what + " is not a direction; give three numbers in pmr, for instance 0,-1,0");
}

void requireKeys(const YAML::Node& entry, const std::set<std::string>& must, const std::set<std::string>& may,
                 const std::string& where) {
  if (!entry.IsMap()) throw PlanError(where + " is not a dictionary");
  std::set<std::string> missing = must;
  for (const auto& pair : entry) {
    const std::string key = pair.first.as<std::string>();
    missing.erase(key);
    if (must.count(key) == 0 && may.count(key) == 0) throw PlanError(where + ": '" + key + "' is unknown");
  }
  if (!missing.empty()) throw PlanError(where + ": '" + *missing.begin() + "' is missing");
}

}  // namespace

PlannedCapture captureFromText(const std::string& text) {
  const std::size_t at = text.rfind('@');
  if (at == std::string::npos) throw PlanError("'" + text + "' is not KEY@SECONDS or KEY@SECONDSxPAIRS");
  PlannedCapture capture;
  capture.key = text.substr(0, at);
  const std::size_t times = text.find('x', at);
  capture.seconds =
      numberIn(text.substr(at + 1, times == std::string::npos ? times : times - at - 1), "'" + text + "'");
  if (times != std::string::npos) capture.pairs = pairsIn(text.substr(times + 1), "'" + text + "'");
  requireKeyIn(capture.key, "'" + text + "'");
  return capture;
}

PlannedShift shiftFromText(const std::string& text) {
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos) throw PlanError("'" + text + "' is not FROM:TO");
  return {text.substr(0, colon), text.substr(colon + 1)};
}

Eigen::Vector3d directionFromText(const std::string& text) {
  std::vector<double> values;
  std::string inner = text;
  inner.erase(std::remove_if(inner.begin(), inner.end(), [](char c) { return c == '[' || c == ']' || c == ' '; }),
              inner.end());
  for (std::size_t at = 0; at <= inner.size();) {
    const std::size_t comma = std::min(inner.find(',', at), inner.size());
    values.push_back(numberIn(inner.substr(at, comma - at), "'" + text + "'"));
    at = comma + 1;
  }
  return direction(values, "'" + text + "'");
}

CasePlan planFromYaml(const std::string& path) {
  try {
    const YAML::Node root = YAML::LoadFile(path);
    requireKeys(root, {"captures"}, {"shifts", "gravity"}, path);
    CasePlan plan;
    for (const YAML::Node& entry : root["captures"]) {
      const std::string where = path + ": capture " + std::to_string(plan.captures.size() + 1);
      requireKeys(entry, {"key", "at"}, {"note", "pairs"}, where);
      PlannedCapture capture;
      capture.key = entry["key"].as<std::string>();
      requireKeyIn(capture.key, where);
      capture.seconds = numberIn(entry["at"].as<std::string>(), where);
      if (entry["pairs"]) capture.pairs = pairsIn(entry["pairs"].as<std::string>(), where);
      if (entry["note"]) capture.note = entry["note"].as<std::string>();
      plan.captures.push_back(capture);
    }
    for (const YAML::Node& entry : root["shifts"]) {
      requireKeys(entry, {"from", "to"}, {}, path + ": shift " + std::to_string(plan.shifts.size() + 1));
      plan.shifts.push_back({entry["from"].as<std::string>(), entry["to"].as<std::string>()});
    }
    if (root["gravity"]) plan.gravity_pmr = direction(root["gravity"].as<std::vector<double>>(), path + ": gravity");
    return plan;
  } catch (const YAML::Exception& error) {
    throw PlanError(path + " cannot be read as a plan: " + error.what());
  }
}

void CasePlan::check() {
  if (captures.empty()) throw PlanError("nothing to capture; say --capture KEY@SECONDS or give a plan");
  std::stable_sort(captures.begin(), captures.end(),
                   [](const PlannedCapture& a, const PlannedCapture& b) { return a.seconds < b.seconds; });
  const auto place = [&](const std::string& key, const PlannedShift& shift) {
    if (key == kMrKey)
      throw PlanError("shift " + shift.from + ":" + shift.to +
                      ": a stage is registered to the preoperative MR after the case is processed, by `rosrun "
                      "cortshift_tracking register_mr DIR STAGE MR`, DIR being the output folder");
    const auto found =
        std::find_if(captures.begin(), captures.end(), [&](const PlannedCapture& c) { return c.key == key; });
    if (found == captures.end())
      throw PlanError("shift " + shift.from + ":" + shift.to + ": stage '" + key + "' is not captured");
    return found;
  };
  std::set<std::string> keys;
  for (const PlannedCapture& capture : captures) {
    if (!keys.insert(capture.key).second) throw PlanError("stage '" + capture.key + "' is captured twice");
    if (capture.seconds < 0) throw PlanError("stage '" + capture.key + "' is to be captured before the bag's start");
  }
  std::set<std::string> seen;
  for (const PlannedShift& shift : shifts) {
    if (place(shift.from, shift) >= place(shift.to, shift))
      throw PlanError("shift " + shift.from + ":" + shift.to +
                      " does not go from an earlier to a later capture; swap the two");
    if (!seen.insert(shift.from + ":" + shift.to).second)
      throw PlanError("shift " + shift.from + ":" + shift.to + " stands twice");
  }
}

}  // namespace cortshift_tracking
