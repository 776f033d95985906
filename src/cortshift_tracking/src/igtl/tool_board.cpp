#include "cortshift_tracking/igtl/tool_board.hpp"

#include <cmath>
#include <cstdlib>
#include <limits>
#include <set>
#include <sstream>

#include "cortshift_flow/range.hpp"

namespace cortshift_tracking::igt {
namespace {

using cortshift_flow::requireRange;

constexpr double kNanoseconds = 1e9;
constexpr std::size_t kMostOthers = 20;  // names; a peer may invent a new one each time

std::int64_t nanoseconds(double seconds) { return std::llround(seconds * kNanoseconds); }

bool isRegistration(const ToolSettings& tool) { return tool.parent == "pmr" || tool.child == "pmr"; }

}  // namespace

void ToolBoardSettings::validate() const {
  requireRange("stale_after", stale_after, 0.01, 10.0);
  requireRange("max_clock_offset", max_clock_offset, 0.001, 3600.0);
  requireRange("same_time", same_time, 0.0, 0.1);
  std::set<std::string> devices, children;
  bool in_tracker = false, reference_in_tracker = false;
  for (const ToolSettings& tool : tools) {
    const std::string name = "tool '" + tool.device + "': ";
    if (tool.device.empty() || tool.device.size() > 20)
      throw std::invalid_argument(name + "a device name has 1 ... 20 characters");
    if (!devices.insert(tool.device).second) throw std::invalid_argument(name + "is configured twice");
    if (tool.parent != "pmr" && tool.parent != "reference" && tool.parent != "tracker")
      throw std::invalid_argument(name + "parent = '" + tool.parent +
                                  "' is not allowed; allowed is pmr, reference, tracker");
    if (tool.child.empty() || tool.child == tool.parent || tool.child == "tracker")
      throw std::invalid_argument(name + "child = '" + tool.child + "' is not allowed with parent " + tool.parent);
    const bool registration = isRegistration(tool);
    if (registration && tool.parent != "reference" && tool.child != "reference")
      throw std::invalid_argument(name + "the patient registration is between pmr and reference, not " + tool.parent +
                                  " and " + tool.child);
    if (!children.insert(registration ? "pmr" : tool.child).second)
      throw std::invalid_argument(name + "its frame has another device already");
    requireRange(name + "latency", tool.latency, -1.0, 1.0);
    in_tracker |= tool.parent == "tracker";
    reference_in_tracker |= tool.parent == "tracker" && tool.child == "reference";
  }
  if (in_tracker && !reference_in_tracker)
    throw std::invalid_argument("tools with parent tracker need one with parent tracker and child reference");
}

const char* toString(ToolStatus status) {
  switch (status) {
    case ToolStatus::kOk:
      return "OK";
    case ToolStatus::kInvalid:
      return "INVALID";
    case ToolStatus::kStale:
      return "STALE";
    case ToolStatus::kNeverSeen:
      return "NEVER SEEN";
  }
  return "";
}

ToolBoard::ToolBoard(const ToolBoardSettings& settings, const LinkSpace& space) : settings_(settings), space_(space) {
  settings_.validate();
  for (const ToolSettings& tool : settings_.tools) {
    Tool entry;
    entry.settings = tool;
    entry.report.device = tool.device;
    entry.report.parent = tool.parent;
    entry.report.child = tool.child;
    entry.report.clock_offset = std::numeric_limits<double>::quiet_NaN();
    tools_.push_back(entry);
  }
}

std::vector<TrackedPose> ToolBoard::receive(std::uint64_t peer, const Message& message, std::int64_t now_ns) {
  std::vector<TrackedPose> poses;
  std::vector<ToolSample> samples;
  if (message.type == "TRANSFORM" || message.type == "POSITION" || message.type == "TDATA") {
    samples = decodePoses(message);
  } else if (message.type == "STATUS") {
    const Status status = decodeStatus(message);
    if (status.code != 1)
      samples.push_back({message.device, std::nullopt, "the device reports status " + std::to_string(status.code)});
  }
  for (const ToolSample& sample : samples) {
    bool known = false;
    for (Tool& tool : tools_) {
      if (tool.settings.device != sample.tool) continue;
      take(tool, peer, sample, message.stamp_ns, now_ns, &poses);
      known = true;
    }
    if (!known) hearOther(sample.tool);
  }
  combine(&poses);
  return poses;
}

void ToolBoard::take(Tool& tool, std::uint64_t peer, const ToolSample& sample, std::int64_t stamp_ns,
                     std::int64_t now_ns, std::vector<TrackedPose>* poses) {
  if (tool.owner != 0 && tool.owner != peer) {
    // The first sender's poses go on: its status is not the second one's to spoil.
    ++tool.report.rejected;
    return;
  }
  tool.owner = peer;
  if (!sample.matrix_mm) return reject(tool, sample.reason);
  if (stamp_ns == 0) return reject(tool, "the device sends no time stamp");
  tool.report.clock_offset = static_cast<double>(now_ns - stamp_ns) / kNanoseconds;
  if (std::abs(tool.report.clock_offset) > settings_.max_clock_offset) {
    std::ostringstream text;
    text << "the device's stamp is " << tool.report.clock_offset << " s behind our clock (allowed is "
         << settings_.max_clock_offset << "): synchronise the clocks";
    return reject(tool, text.str());
  }
  if (stamp_ns <= tool.last_sample_ns) {
    ++tool.report.repeated;
    return;
  }
  tool.last_sample_ns = stamp_ns;
  TrackedPose pose;
  pose.parent = tool.settings.parent;
  pose.child = tool.settings.child;
  pose.stamp_ns = stamp_ns - nanoseconds(tool.settings.latency);
  try {
    pose.T_parent_child = space_.poseFromLink(*sample.matrix_mm, pose.parent, pose.child);
  } catch (const PoseError& error) {
    return reject(tool, error.what());
  }
  if (pose.parent == "tracker") {
    if (tool.waiting) reject(tool, "the reference was not seen at the same time");
    tool.seen_tracker = pose;
    tool.waiting = true;
    return;
  }
  // tf has pmr as its root, whichever way round the registration is sent.
  if (pose.child == "pmr") {
    std::swap(pose.parent, pose.child);
    pose.T_parent_child = pose.T_parent_child.inverse();
  }
  accept(tool, pose, poses);
}

void ToolBoard::combine(std::vector<TrackedPose>* poses) {
  Tool* reference = nullptr;
  for (Tool& tool : tools_)
    if (tool.settings.parent == "tracker" && tool.settings.child == "reference") reference = &tool;
  if (reference == nullptr || !reference->seen_tracker) return;
  const TrackedPose& seen = *reference->seen_tracker;
  if (reference->waiting) {
    // Its own pose is no edge of the tree; that it is seen is what counts.
    accept(*reference, seen, nullptr);
    reference->waiting = false;
  }
  for (Tool& tool : tools_) {
    if (!tool.waiting || &tool == reference) continue;
    TrackedPose pose = *tool.seen_tracker;
    if (std::abs(pose.stamp_ns - seen.stamp_ns) > nanoseconds(settings_.same_time)) continue;
    pose.parent = "reference";
    pose.T_parent_child = seen.T_parent_child.inverse() * pose.T_parent_child;
    tool.waiting = false;
    accept(tool, pose, poses);
  }
}

void ToolBoard::hearOther(const std::string& device) {
  if (others_.size() < kMostOthers) others_.insert(device);
}

std::string ToolBoard::nothingHeard() const {
  std::string text = "the device has sent nothing";
  if (others_.empty()) return text;
  text += "; poses come under names that are not configured: ";
  for (auto name = others_.begin(); name != others_.end(); ++name)
    text += (name == others_.begin() ? "" : ", ") + *name;
  return text + "; set `device` of the tool to the name that is sent";
}

void ToolBoard::reject(Tool& tool, const std::string& reason) {
  ++tool.report.rejected;
  tool.report.reason = reason;
  tool.invalid = true;
}

void ToolBoard::accept(Tool& tool, const TrackedPose& pose, std::vector<TrackedPose>* poses) {
  ++tool.report.accepted;
  tool.last_pose_ns = pose.stamp_ns;
  tool.report.reason.clear();
  tool.invalid = false;
  if (poses != nullptr) poses->push_back(pose);
}

void ToolBoard::peerLeft(std::uint64_t peer) {
  for (Tool& tool : tools_)
    if (tool.owner == peer) tool.owner = 0;
}

std::vector<ToolReport> ToolBoard::report(std::int64_t now_ns) const {
  std::vector<ToolReport> reports;
  for (const Tool& tool : tools_) {
    ToolReport report = tool.report;
    const bool seen = report.accepted > 0;
    report.age = seen ? static_cast<double>(now_ns - tool.last_pose_ns) / kNanoseconds
                      : std::numeric_limits<double>::quiet_NaN();
    // A registration holds until another one comes.
    const bool stale =
        seen && !isRegistration(tool.settings) && report.age > settings_.stale_after + tool.settings.latency;
    if (tool.invalid) {
      report.status = ToolStatus::kInvalid;
    } else if (!seen) {
      report.reason = tool.waiting ? "the reference was not seen at the same time" : nothingHeard();
    } else if (stale) {
      report.status = ToolStatus::kStale;
      report.reason = "the last good pose is too old";
    } else {
      report.status = ToolStatus::kOk;
    }
    reports.push_back(report);
  }
  return reports;
}

}  // namespace cortshift_tracking::igt
