// What belongs to a case beside its stages: gravity, the regions excluded by hand, the outlines of the brain drawn by
// hand, live mode. On disk before it counts.
#pragma once

#include <cortshift_msgs/StageInfo.h>

#include <Eigen/Core>
#include <filesystem>
#include <iosfwd>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_tracking/field/exclusion.hpp"

namespace cortshift_tracking {

constexpr const char* kCaseStateFile = "case_state.json";

/// Unit vector of a direction, or nothing for one that is none (not finite, or zero).
std::optional<Eigen::Vector3d> unitVector(const Eigen::Vector3d& direction);

using RegionsByKey = std::map<std::string, std::vector<Region>>;

struct Gravity {
  Eigen::Vector3d direction_pmr;  ///< unit length, down
  std::string source;             ///< where it is from, for people
};

/// Live mode that is on: it goes on where the node is started again under the same master.
struct LiveMode {
  std::string key;  ///< of the stage that it starts from
  ros::Time stamp;  ///< of that stage: another one of the same key is another one
  std::string run;  ///< run_id of the master
};

/// Thread-safe. Kept in case_state.json of the case folder, which the StageStore of the case holds the lock of.
///
/// A file that was read and found damaged is set aside. One that cannot be read just now, or is of another version,
/// stays as it is: whatever needs it is refused until it can be read, which is tried each time.
class CaseState {
 public:
  /// What the configuration says; it holds until the case itself says something else.
  struct Configured {
    std::optional<Eigen::Vector3d> gravity_pmr;
    RegionsByKey regions;
  };

  CaseState(const std::filesystem::path& folder, const Configured& configured);

  /// @throws UnreadableFile
  std::optional<Gravity> gravity() const;

  /// Regions by the key of their stage, for the stages that there are. Regions belong to one capture: a later stage of
  /// the same key starts without any. @throws UnreadableFile
  RegionsByKey regions(const std::vector<cortshift_msgs::StageInfo>& stages) const;

  /// The same for one stage. @throws UnreadableFile
  std::vector<Region> regionsOf(const cortshift_msgs::StageInfo& stage) const;

  /// Outlines of the brain as they were drawn, the same way. @throws UnreadableFile
  RegionsByKey outlines(const std::vector<cortshift_msgs::StageInfo>& stages) const;
  std::vector<Region> outlineOf(const cortshift_msgs::StageInfo& stage) const;

  /// Returns when it is safe on disk. @param direction_pmr unit length @throws TrackingError; then nothing has changed
  void setGravity(const Eigen::Vector3d& direction_pmr, const std::string& source);

  /// @throws UnreadableFile
  std::optional<LiveMode> live() const;

  /// Nothing: live mode is off. See setGravity.
  void setLive(const std::optional<LiveMode>& live);

  /// Replaces the regions of a stage; see setGravity. @throws TrackingError also for what is no region
  void exclude(const cortshift_msgs::StageInfo& stage, const std::vector<Region>& regions);

  /// Replaces the outline of the brain on a stage, none: the automatic one again; see exclude.
  void setOutline(const cortshift_msgs::StageInfo& stage, const std::vector<Region>& brain);

  /// After a stage was deleted. @throws TrackingError
  void forget(const std::string& key);

  /// What a person should know: that the file cannot be read, or was damaged. Empty: nothing.
  std::string trouble() const;

 private:
  struct OnStage {
    ros::Time stamp;  // of the stage; zero: whatever stage has the key
    std::vector<Region> regions;
  };
  using OnStages = std::map<std::string, OnStage>;
  struct Content {
    std::optional<Gravity> gravity;
    OnStages excluded, outlines;
    std::optional<LiveMode> live;
  };

  Content& content() const;  // of the file, which is read first where it has not been
  void write(const Content& content);
  static std::vector<Region> regionsIn(const OnStages& drawn, const RegionsByKey& configured, const std::string& key,
                                       const ros::Time& stamp);
  static RegionsByKey regionsIn(const OnStages& drawn, const RegionsByKey& configured,
                                const std::vector<cortshift_msgs::StageInfo>& stages);
  static void appendJson(std::ostream& out, const char* name, const OnStages& drawn);
  static std::string toJson(const Content& content);
  static Content fromJson(const std::string& text);

  const std::filesystem::path folder_, path_;
  const Configured configured_;
  mutable std::mutex mutex_;
  mutable std::optional<Content> content_;  // nothing: not read yet
  mutable std::string set_aside_;           // what became of a damaged file
};

}  // namespace cortshift_tracking
