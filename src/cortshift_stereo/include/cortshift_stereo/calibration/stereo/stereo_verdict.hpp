// Whether a calibration of the stereo head can be used.
#pragma once

#include <optional>

#include "cortshift_stereo/calibration/calibration_verdict.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

namespace cortshift_stereo {

/// @param checks  on views that were kept out of the fit on purpose
CalibrationVerdict judgeStereo(const StereoCalibration& calibration, const std::optional<SetErrors>& checks);

}  // namespace cortshift_stereo
