// What the navigation system says about its tools, turned into poses of our frames, and what is wrong with each tool.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cortshift_tracking/igtl/space.hpp"
#include "cortshift_tracking/igtl/wire.hpp"

namespace cortshift_tracking::igt {

/// One device (or tool of a TDATA message) that we listen to. Its matrix is the pose of `child` in `parent`.
struct ToolSettings {
  std::string device;
  std::string parent;  ///< pmr, reference or tracker
  std::string child;   ///< microscope, probe_tip, reference, ...
  double latency = 0;  ///< the device's stamp is this much later than its measurement [s]
};

struct ToolBoardSettings {
  std::vector<ToolSettings> tools;
  double stale_after = 0.2;       ///< a tool without a good pose for this long is stale [s]
  double max_clock_offset = 0.5;  ///< largest difference between a device's stamp and our clock on arrival [s]
  double same_time = 0.001;       ///< tool and reference seen in the tracker's frame belong together within this [s]

  /// @throws std::invalid_argument naming the tool or setting and what is allowed.
  void validate() const;
};

/// A good pose in the direction that the tf tree has: pmr -> reference, or reference -> any tool.
struct TrackedPose {
  std::string parent, child;
  std::int64_t stamp_ns = 0;  ///< of the measurement: latency taken off
  Eigen::Isometry3d T_parent_child = Eigen::Isometry3d::Identity();
};

enum class ToolStatus { kOk, kInvalid, kStale, kNeverSeen };
const char* toString(ToolStatus status);

struct ToolReport {
  std::string device, parent, child;
  ToolStatus status = ToolStatus::kNeverSeen;
  std::string reason;          ///< why it is not OK
  std::uint64_t accepted = 0;  ///< good poses so far
  std::uint64_t rejected = 0;  ///< samples without a good pose
  std::uint64_t repeated = 0;  ///< samples not newer than the last
  double age = 0;              ///< of the last good pose [s]; NaN: there was none
  double clock_offset = 0;     ///< our clock on arrival less the stamp, last sample [s]; NaN: there was none
};

/// Poses measured in the tracker's own frame (parent `tracker`) are given in `reference` by the reference body seen at
/// the same time; without one they are no pose. A tool belongs to the peer that first sends it, until that peer
/// leaves: a second sender is refused. Not for several threads.
class ToolBoard {
 public:
  /// @throws std::invalid_argument from ToolBoardSettings::validate.
  ToolBoard(const ToolBoardSettings& settings, const LinkSpace& space);

  /// TRANSFORM, POSITION, TDATA and STATUS; other types are ignored, names of other devices are kept for the report.
  /// @throws ProtocolError if the content breaks the protocol.
  std::vector<TrackedPose> receive(std::uint64_t peer, const Message& message, std::int64_t now_ns);

  void peerLeft(std::uint64_t peer);

  std::vector<ToolReport> report(std::int64_t now_ns) const;

 private:
  struct Tool {
    ToolSettings settings;
    ToolReport report;
    std::uint64_t owner = 0;
    std::int64_t last_sample_ns = 0;
    std::int64_t last_pose_ns = 0;
    bool invalid = false;
    // Parent `tracker` only: seen, and waiting for the reference body of the same time.
    std::optional<TrackedPose> seen_tracker;
    bool waiting = false;
  };

  void take(Tool& tool, std::uint64_t peer, const ToolSample& sample, std::int64_t stamp_ns, std::int64_t now_ns,
            std::vector<TrackedPose>* poses);
  void reject(Tool& tool, const std::string& reason);
  void accept(Tool& tool, const TrackedPose& pose, std::vector<TrackedPose>* poses);
  void combine(std::vector<TrackedPose>* poses);
  void hearOther(const std::string& device);
  std::string nothingHeard() const;

  ToolBoardSettings settings_;
  LinkSpace space_;
  std::vector<Tool> tools_;
  std::set<std::string> others_;  ///< names heard that no tool is configured under
};

}  // namespace cortshift_tracking::igt
