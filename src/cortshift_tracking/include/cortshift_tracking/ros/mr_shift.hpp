// The shift of a stage against the brain of the preoperative MR.
#pragma once

#include <optional>
#include <string>

#include "cortshift_tracking/ros/stage_shift.hpp"

namespace cortshift_tracking {

/// From the MR's cortex (key "pmr") to a stage. `register_mr` has registered a stage to the MR and left the field in
/// the case folder, fields/pmr__STAGE.bag; to another stage it goes on from there by the shift between the two (Ji et
/// al. 2014, Discussion). Of several registered stages the last one up to `to_key` is taken. The compute time of the
/// summary includes that of the registration.
/// @param drawn as for computeStageShift
/// @throws TrackingError for an unknown stage, one that nothing is registered for (with the command that does it), a
///         field that does not belong to its stage, and as computeStageShift
StageShift computeMrShift(const StageStore& store, const std::string& to_key, FirstNormal& first_normal,
                          const std::optional<Eigen::Vector3d>& gravity_pmr, const ShiftSettings& settings,
                          const Drawn& drawn = {}, bool across_epochs = false);

}  // namespace cortshift_tracking
