// What a processed case leaves on disk.
#pragma once

#include <filesystem>
#include <string>

#include "cortshift_tracking/case/stage_store.hpp"
#include "cortshift_tracking/ros/stage_shift.hpp"

namespace cortshift_tracking {

/// A folder of its own: `stages/` (the store), FROM__TO.bag with the DisplacementField on /shift/field, summary.csv,
/// and timing.csv. All but timing.csv depend on the input alone, bit for bit; wall times stand there and nowhere else.
class CaseOutput {
 public:
  /// @throws TrackingError if the folder cannot be had or holds anything already
  explicit CaseOutput(const std::filesystem::path& folder);

  StageStore& store() { return store_; }

  /// Writes the field's bag and keeps its line of the summary.
  void add(const StageShift& shift);
  void addTiming(const std::string& step, double seconds);

  /// Writes the tables.
  void finish() const;

 private:
  std::filesystem::path folder_;
  StageStore store_;
  std::string summary_, timing_;
};

}  // namespace cortshift_tracking
