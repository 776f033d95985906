// What a calibration of the settings leaves behind: the fields and how good they are.
#pragma once

#include <string>
#include <vector>

#include "cortshift_stereo/calibration/calibration_verdict.hpp"
#include "cortshift_stereo/calibration/settings/settings_calibration.hpp"

namespace cortshift_stereo {

/// Write settings_left.yaml, settings_right.yaml and settings_report.yaml into a folder, which is made if missing; of a
/// useless calibration the report alone.
/// @param date     ISO 8601
/// @param rejected  images in which the board was not found
/// @throws CalibrationError if something cannot be written.
void writeSettingsCalibration(const std::string& folder, const std::string& date, const SettingsCalibration& left,
                              const SettingsCalibration& right, const std::vector<RejectedView>& rejected,
                              const CalibrationVerdict& verdict);

}  // namespace cortshift_stereo
