#include "cortshift_tracking/case/case_state.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <locale>
#include <new>
#include <sstream>

#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/case/stage_key.hpp"

namespace cortshift_tracking {
namespace {

const std::string kFormat = "cortshift case state, version 1";
const std::string kAnyFormat = "cortshift case state, version ";

/// Text between double quotes: sources are our own sentences, with nothing in them that JSON would escape.
std::string quoted(std::string text) {
  for (char& c : text)
    if (c == '"' || c == '\\' || static_cast<unsigned char>(c) < ' ') c = '\'';
  return '"' + text + '"';
}

template <typename Items, typename Write>
void list(std::ostream& out, const Items& items, const Write& write) {
  out << '[';
  bool first = true;
  for (const auto& item : items) {
    if (!first) out << ", ";
    first = false;
    write(item);
  }
  out << ']';
}

void writeStamp(std::ostream& out, const ros::Time& stamp) { out << '[' << stamp.sec << ", " << stamp.nsec << ']'; }

/// @param whose  for the refusal
ros::Time stampOf(const YAML::Node& node, const std::string& whose) {
  const auto stamp = node.as<std::vector<std::uint32_t>>();
  if (stamp.size() != 2 || stamp[1] >= 1000000000U) throw TrackingError("the stamp of '" + whose + "' is none");
  return {stamp[0], stamp[1]};
}

double finite(const YAML::Node& node) {
  const auto value = node.as<double>();
  if (!std::isfinite(value)) throw TrackingError("it holds a number that is not finite");
  return value;
}

}  // namespace

std::optional<Eigen::Vector3d> unitVector(const Eigen::Vector3d& direction) {
  constexpr double kShortest = 1e-6;  // less is a zero that was rounded
  if (!direction.allFinite() || !(direction.norm() > kShortest)) return std::nullopt;
  return direction.normalized();
}

CaseState::CaseState(const std::filesystem::path& folder, const Configured& configured)
    : folder_(folder), path_(folder / kCaseStateFile), configured_(configured) {}

std::optional<Gravity> CaseState::gravity() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  const auto& kept = content().gravity;
  if (!configured_.gravity_pmr) return kept;
  if (!kept) return Gravity{*configured_.gravity_pmr, "the parameter gravity"};
  // Measured in this case, it counts more than what was configured before; but nobody should have to guess.
  const double apart = std::acos(std::clamp(kept->direction_pmr.dot(*configured_.gravity_pmr), -1.0, 1.0)) * 180 / M_PI;
  char text[120];
  std::snprintf(text, sizeof text, "; the parameter gravity, %.1f degrees from it, does not count", apart);
  return Gravity{kept->direction_pmr, kept->source + text};
}

std::vector<Region> CaseState::regionsIn(const OnStages& drawn, const RegionsByKey& configured, const std::string& key,
                                         const ros::Time& stamp) {
  const auto kept = drawn.find(key);
  if (kept != drawn.end()) {
    // Of a stage that cannot be read only the key is known: it may be read by the time that it is used.
    const bool same = kept->second.stamp.isZero() || stamp.isZero() || kept->second.stamp == stamp;
    return same ? kept->second.regions : std::vector<Region>();
  }
  const auto given = configured.find(key);
  return given == configured.end() ? std::vector<Region>() : given->second;
}

RegionsByKey CaseState::regionsIn(const OnStages& drawn, const RegionsByKey& configured,
                                  const std::vector<cortshift_msgs::StageInfo>& stages) {
  RegionsByKey regions;
  for (const cortshift_msgs::StageInfo& stage : stages) {
    const auto of_stage = regionsIn(drawn, configured, stage.key, stage.stamp);
    if (!of_stage.empty()) regions[stage.key] = of_stage;
  }
  return regions;
}

RegionsByKey CaseState::regions(const std::vector<cortshift_msgs::StageInfo>& stages) const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return regionsIn(content().excluded, configured_.regions, stages);
}

std::vector<Region> CaseState::regionsOf(const cortshift_msgs::StageInfo& stage) const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return regionsIn(content().excluded, configured_.regions, stage.key, stage.stamp);
}

RegionsByKey CaseState::outlines(const std::vector<cortshift_msgs::StageInfo>& stages) const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return regionsIn(content().outlines, {}, stages);
}

std::vector<Region> CaseState::outlineOf(const cortshift_msgs::StageInfo& stage) const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return regionsIn(content().outlines, {}, stage.key, stage.stamp);
}

void CaseState::setGravity(const Eigen::Vector3d& direction_pmr, const std::string& source) {
  const std::lock_guard<std::mutex> guard(mutex_);
  Content changed = content();
  changed.gravity = Gravity{direction_pmr, source};
  write(changed);
}

std::optional<LiveMode> CaseState::live() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return content().live;
}

void CaseState::setLive(const std::optional<LiveMode>& live) {
  const std::lock_guard<std::mutex> guard(mutex_);
  Content changed = content();
  if (!live && !changed.live) return;
  changed.live = live;
  write(changed);
}

void CaseState::exclude(const cortshift_msgs::StageInfo& stage, const std::vector<Region>& regions) {
  excludedMask(ProjectionFrame(), regions);  // checks them
  const std::lock_guard<std::mutex> guard(mutex_);
  Content changed = content();
  changed.excluded[stage.key] = {stage.stamp, regions};
  write(changed);
}

void CaseState::setOutline(const cortshift_msgs::StageInfo& stage, const std::vector<Region>& brain) {
  excludedMask(ProjectionFrame(), brain);  // checks it
  const std::lock_guard<std::mutex> guard(mutex_);
  Content changed = content();
  if (brain.empty())
    changed.outlines.erase(stage.key);
  else
    changed.outlines[stage.key] = {stage.stamp, brain};
  write(changed);
}

void CaseState::forget(const std::string& key) {
  const std::lock_guard<std::mutex> guard(mutex_);
  Content changed = content();
  const bool kept = changed.excluded.erase(key) + changed.outlines.erase(key) > 0,
             configured = configured_.regions.count(key) > 0;
  if (!kept && !configured) return;
  if (configured) changed.excluded[key] = {};  // the configured ones were drawn on the stage that is gone
  write(changed);
}

std::string CaseState::trouble() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  try {
    content();
    return set_aside_;
  } catch (const UnreadableFile& error) {
    return error.what();
  }
}

CaseState::Content& CaseState::content() const {
  if (content_) return *content_;
  std::error_code ignored;
  if (std::filesystem::symlink_status(path_, ignored).type() == std::filesystem::file_type::not_found)
    return content_.emplace();
  const std::string text = readWhole(path_);
  try {
    return content_.emplace(fromJson(text));
  } catch (const UnreadableFile& error) {
    throw UnreadableFile(path_.string() + ": " + error.what());
  } catch (const std::bad_alloc&) {
    throw UnreadableFile("cannot read " + path_.string() + ": no memory");
  } catch (const std::exception& error) {  // yaml-cpp's and our own
    set_aside_ = path_.string() + " is damaged (" + error.what() + ")";
  }
  try {
    set_aside_ += " and set aside as " + moveAside(folder_, path_).string();
  } catch (const TrackingError&) {  // a read-only folder: naming the file is all that can be done
  }
  set_aside_ += "; give gravity and excluded regions again, and outlines that were drawn";
  return content_.emplace();
}

void CaseState::write(const Content& content) {
  const std::string text = toJson(content);
  replaceDurably(path_, text.data(), text.size());
  content_ = content;
}

std::string CaseState::toJson(const Content& content) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(17);  // what a double needs to be read back as it was
  out << "{\"format\": " << quoted(kFormat) << ", \"unit\": \"m\",\n \"gravity\": ";
  if (content.gravity) {
    const Eigen::Vector3d& down = content.gravity->direction_pmr;
    out << "{\"direction_pmr\": [" << down.x() << ", " << down.y() << ", " << down.z()
        << "], \"source\": " << quoted(content.gravity->source) << "}";
  } else {
    out << "null";
  }
  appendJson(out, "excluded", content.excluded);
  appendJson(out, "outlines", content.outlines);
  if (content.live) {
    out << ",\n \"live\": {\"from\": " << quoted(content.live->key) << ", \"stamp\": ";
    writeStamp(out, content.live->stamp);
    out << ", \"run\": " << quoted(content.live->run) << '}';
  }
  out << "}\n";
  return out.str();
}

void CaseState::appendJson(std::ostream& out, const char* name, const OnStages& drawn) {
  out << ",\n " << quoted(name) << ": {";
  bool first = true;
  for (const auto& [key, on_stage] : drawn) {
    out << (first ? "\n  " : ",\n  ") << quoted(key) << ": {\"stamp\": ";
    writeStamp(out, on_stage.stamp);
    out << ", \"regions\": ";
    first = false;
    list(out, on_stage.regions, [&](const Region& region) {
      list(out, region, [&](const cv::Point2d& corner) { out << '[' << corner.x << ", " << corner.y << ']'; });
    });
    out << '}';
  }
  out << '}';
}

CaseState::Content CaseState::fromJson(const std::string& text) {
  const YAML::Node root = YAML::Load(text);  // JSON is YAML too
  if (!root.IsMap()) throw TrackingError("it is not a JSON object");
  const auto format = root["format"].as<std::string>();
  if (format != kFormat && format.compare(0, kAnyFormat.size(), kAnyFormat) == 0)
    throw UnreadableFile("it is a \"" + format + "\", which this software does not know; use the one that wrote it");
  if (format != kFormat || root["unit"].as<std::string>() != "m")
    throw TrackingError("it is not a \"" + kFormat + "\" in metres");
  Content content;
  const YAML::Node gravity = root["gravity"], excluded = root["excluded"];
  if (!gravity || !excluded || !excluded.IsMap()) throw TrackingError("gravity or excluded is missing");
  if (!gravity.IsNull()) {
    const YAML::Node xyz = gravity["direction_pmr"];
    if (!xyz || xyz.size() != 3) throw TrackingError("gravity has no direction");
    const Eigen::Vector3d down(finite(xyz[0]), finite(xyz[1]), finite(xyz[2]));
    constexpr double kRounding = 1e-9;  // of a unit vector that was written with every digit
    if (!(std::abs(down.norm() - 1) <= kRounding)) throw TrackingError("gravity is no unit vector");
    content.gravity = Gravity{down, gravity["source"].as<std::string>()};
  }
  const auto read = [](const YAML::Node& node, OnStages& drawn) {
    for (const auto& entry : node) {
      const auto key = entry.first.as<std::string>();
      requireKey(key);
      OnStage& out = drawn[key];
      out.stamp = stampOf(entry.second["stamp"], key);
      for (const YAML::Node& polygon : entry.second["regions"]) {
        Region region;
        for (const YAML::Node& corner : polygon) {
          if (corner.size() != 2) throw TrackingError("a corner of '" + key + "' is not [x, y]");
          region.emplace_back(finite(corner[0]), finite(corner[1]));
        }
        out.regions.push_back(region);
      }
      excludedMask(ProjectionFrame(), out.regions);  // checks them
    }
  };
  read(excluded, content.excluded);
  // Cases from before there were outlines have none.
  if (const YAML::Node outlines = root["outlines"]) {
    if (!outlines.IsMap()) throw TrackingError("outlines are no mapping");
    read(outlines, content.outlines);
  }
  if (const YAML::Node live = root["live"]) {
    const auto key = live["from"].as<std::string>();
    requireKey(key);
    content.live = {key, stampOf(live["stamp"], key), live["run"].as<std::string>()};
  }
  return content;
}

}  // namespace cortshift_tracking
