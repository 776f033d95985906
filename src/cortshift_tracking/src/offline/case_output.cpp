#include "cortshift_tracking/offline/case_output.hpp"

#include <cstdio>

#include "cortshift_tracking/case/bag_access.hpp"
#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/ros/field_message.hpp"

namespace cortshift_tracking {
namespace {

namespace fs = std::filesystem;

/// The folder, empty. Before the store is made in it.
const fs::path& emptied(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (!fs::is_directory(folder))
    throw TrackingError("output folder " + folder.string() + " cannot be created: " + error.message());
  if (!fs::is_empty(folder))
    throw TrackingError("output folder " + folder.string() +
                        " is not empty; nothing is overwritten: remove it or choose another");
  return folder;
}

/// Shortest text that reads back as the same number; empty: not known.
std::string cell(double value) {
  if (value != value) return ",";
  char text[40];
  for (int digits = 6; digits <= 17; ++digits) {
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    if (std::stod(text) == value) break;
  }
  return std::string(",") + text;
}

/// RFC 4180: quoted, quotes doubled.
std::string textCell(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += (text.empty() ? "" : " | ") + line;
  if (text.empty()) return ",";
  for (std::size_t at = 0; (at = text.find('"', at)) != std::string::npos; at += 2) text.insert(at, 1, '"');
  return ",\"" + text + "\"";
}

}  // namespace

CaseOutput::CaseOutput(const fs::path& folder)
    : folder_(emptied(folder)),
      store_(folder / "stages"),
      summary_(
          "from_key,to_key,valid_points,overlap,magnitude_mean_m,magnitude_sd_m,gravity_mean_m,gravity_sd_m,"
          "normal_mean_m,normal_sd_m,lateral_mean_m,lateral_sd_m,gravity_normal_angle_rad,warnings,common_sd_m,"
          "brain_points,brain_magnitude_mean_m,brain_magnitude_sd_m,brain_gravity_mean_m,brain_gravity_sd_m,"
          "brain_normal_mean_m,brain_normal_sd_m,brain_lateral_mean_m,brain_lateral_sd_m,outline,surround\n"),
      timing_("step,seconds\n") {}

void CaseOutput::add(const StageShift& shift) {
  cortshift_msgs::DisplacementField message = toMessage(shift.result.field, shift.result.summary, shift.from, shift.to);
  message.summary.compute_time = kUnknown;  // of this machine; it stands in timing.csv
  const std::string bytes = bagBytes(
      [&](rosbag::Bag& bag) { bag.write("/shift/field", std::max(message.header.stamp, ros::TIME_MIN), message); });
  const std::string name = shift.from.key + "__" + shift.to.key;
  writeDurably(folder_ / (name + ".bag"), bytes.data(), bytes.size());
  const cortshift_msgs::ShiftSummary& s = message.summary;
  summary_ += s.from_key + "," + s.to_key + "," + std::to_string(s.valid_points) + cell(s.overlap) +
              cell(s.magnitude_mean) + cell(s.magnitude_sd) + cell(s.gravity_mean) + cell(s.gravity_sd) +
              cell(s.normal_mean) + cell(s.normal_sd) + cell(s.lateral_mean) + cell(s.lateral_sd) +
              cell(s.gravity_normal_angle) + textCell(s.warnings) + cell(s.common_sd) + "," +
              std::to_string(s.brain_points) + cell(s.brain_magnitude_mean) + cell(s.brain_magnitude_sd) +
              cell(s.brain_gravity_mean) + cell(s.brain_gravity_sd) + cell(s.brain_normal_mean) +
              cell(s.brain_normal_sd) + cell(s.brain_lateral_mean) + cell(s.brain_lateral_sd) + textCell({s.outline}) +
              textCell({s.surround}) + "\n";
}

void CaseOutput::addTiming(const std::string& step, double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, ",%.3f\n", seconds);
  timing_ += step + text;
}

void CaseOutput::finish() const {
  writeDurably(folder_ / "summary.csv", summary_.data(), summary_.size());
  writeDurably(folder_ / "timing.csv", timing_.data(), timing_.size());
}

}  // namespace cortshift_tracking
