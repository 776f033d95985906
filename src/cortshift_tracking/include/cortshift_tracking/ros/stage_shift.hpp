// The shift between two stages of a store: the step that a service call and a recorded case share.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_tracking/case/stage_store.hpp"
#include "cortshift_tracking/shift.hpp"

namespace cortshift_tracking {

/// The average normal of a case's first stage, which every summary refers to. Remembers it.
class FirstNormal {
 public:
  /// @throws TrackingError if the store is empty
  Eigen::Vector3d of(const StageStore& store);

 private:
  std::string key_;
  ros::Time stamp_;
  Eigen::Vector3d normal_;
};

struct StageShift {
  cortshift_msgs::StageInfo from, to;
  ShiftResult result;
};

/// What makes the difference of two stages no movement of the brain; nothing: they are of one epoch.
/// @param later  also a surface that is no stage: it has no key and no epoch of its own
std::optional<std::string> changeBetween(const cortshift_msgs::StageInfo& earlier,
                                         const cortshift_msgs::StageInfo& later);

/// The warnings of both stages, each with its key; a surface that is no stage has none.
std::vector<std::string> warningsOf(const cortshift_msgs::StageInfo& from, const cortshift_msgs::StageInfo& to);

/// What is known of the pair. @param from the earlier stage's record
/// @param brain as drawn by hand on the earlier stage; empty: not drawn
PairKnowledge knowledgeOf(const StageRecord& from, const cortshift_msgs::StageInfo& to,
                          const SurroundSettings& settings, const std::vector<Region>& brain);

/// What people drew on stages, in each stage's projection frame, by its key.
struct Drawn {
  std::map<std::string, std::vector<Region>> excluded;  ///< regions that take no part
  std::map<std::string, std::vector<Region>> brain;     ///< outline of the exposed brain

  static std::vector<Region> of(const std::map<std::string, std::vector<Region>>& regions, const std::string& key);
};

/// The summary carries the warnings of both stages.
/// @param across_epochs also between stages of different patient registrations or calibrations, which is warned of
/// @throws TrackingError for unknown keys, equal ones, the wrong order or different epochs, and as computeShift
StageShift computeStageShift(const StageStore& store, const std::string& from_key, const std::string& to_key,
                             FirstNormal& first_normal, const std::optional<Eigen::Vector3d>& gravity_pmr,
                             const ShiftSettings& settings, const Drawn& drawn = {}, bool across_epochs = false);

}  // namespace cortshift_tracking
