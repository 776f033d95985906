// The case that a running node works on: what its services share.
#pragma once

#include <mutex>
#include <string>

#include "cortshift_tracking/case/case_state.hpp"
#include "cortshift_tracking/case/stage_store.hpp"
#include "cortshift_tracking/ros/parameters.hpp"
#include "cortshift_tracking/ros/stage_shift.hpp"

namespace cortshift_tracking {

/// Parameters: case_folder (empty: one for each ROS master and namespace under ~/.ros/cortshift), gravity, exclusions.
struct OpenCase {
  /// @throws TrackingError if the case folder or the file of exclusions cannot be used
  explicit OpenCase(const ShiftTrackerParameters& parameters);

  /// What a field is measured against. To be called with `computing` held.
  /// @throws TrackingError where there is no stage, or the case cannot be read
  Directions directions();

  StageStore store;
  CaseState state;
  std::mutex computing;      // one computation at a time: each takes every core
  FirstNormal first_normal;  // with computing held
};

}  // namespace cortshift_tracking
