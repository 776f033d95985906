// What is known of the cameras, the microscope and the clock of a pair, before its images are looked at.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_stereo/calibration/settings/settings_warp.hpp"
#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// tf and camera_info about the same stereo head: of two truths none is believed.
/// @param T_left_right  right_optical in left_optical, both raw, as tf says
Findings checkStereoEdge(const StereoModel& model, const Eigen::Isometry3d& T_left_right);

/// A microscope that does not say how it is set, or says what cannot be (see MicroscopeSetting::possible).
/// @param said     on /microscope/settings; empty: nothing
/// @param several  a settings calibration is in use, so that the setting decides about the geometry
Findings checkSettingKnown(const std::optional<MicroscopeSetting>& said, bool several);

/// A tracker's clock that is ahead of the one that notes when its samples come in.
/// @param edge  "reference -> microscope"
/// @param lags  [s] from the stamp of a sample until it came in, at least one
/// @param pair_lag  [s] the same of the pair of images
Findings checkTrackerClock(const std::string& edge, std::vector<double> lags, double pair_lag);

/// The clock that stamped an exposure against the one that noted when the pair came.
/// @param thing     that is stamped, "The stamp of the pair"
/// @param lag       [s] came minus exposed
/// @param most      [s] that the way from the camera may take, at least a period of the pairs
/// @param clock     whose time it came at, "record time"
Findings checkLag(const std::string& thing, double lag, double most, const std::string& clock);

/// A capture that had to wait for a pair: what it shows may be of another stage.
/// @param late  [s] exposure after the time that was asked for
/// @param most  [s]
Findings checkWait(double late, double most);

/// Zero is no time of an exposure.
Findings checkStamp(int64_t stamp_ns);

}  // namespace cortshift_stereo
