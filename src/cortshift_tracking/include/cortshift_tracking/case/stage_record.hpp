// From a surface and what was seen with it to a complete stage: the step that a running node and a recorded case share.
#pragma once

#include <string>

#include "cortshift_stereo/ros/pose_source.hpp"
#include "cortshift_tracking/case/stage_store.hpp"

namespace cortshift_tracking {

/// Fills the transforms of a record that has info.stamp, parameters and what is known of the pair, and what follows
/// from them: camera pose, what it may be off by where the samples around it are known, registration, provenance.
/// @param latency_sd  of the poses' stamps against the exposure [s]
/// @returns as completeStage
std::string placeRecord(StageRecord& record, const cortshift_stereo::PoseSource& poses, double latency_sd);

/// Fills info (but for the epoch, which the store counts) and transforms of a record that has info.key, info.note,
/// info.stamp, surface, parameters and what is known of the pair. What info.warnings says already stays.
/// @returns what a person should know about what is missing; each remark begins with "; "
/// @throws TrackingError or cortshift_stereo::MessageError for a surface that no shift can be computed from
std::string completeStage(StageRecord& record, const cortshift_stereo::PoseSource& poses, double latency_sd);

}  // namespace cortshift_tracking
