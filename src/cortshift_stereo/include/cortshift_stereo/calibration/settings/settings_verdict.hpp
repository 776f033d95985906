// Whether a calibration of the microscope's settings can be used.
#pragma once

#include "cortshift_stereo/calibration/calibration_verdict.hpp"
#include "cortshift_stereo/calibration/settings/settings_calibration.hpp"

namespace cortshift_stereo {

/// @param without_board  how many images show no board
CalibrationVerdict judgeSettings(const SettingsCalibration& left, const SettingsCalibration& right,
                                 std::size_t without_board = 0);

}  // namespace cortshift_stereo
