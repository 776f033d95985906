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

/// What the fields leave, as their report says.
struct SettingsResiduals {
  MicroscopeSetting reference;
  double disparity_rms = 0;  ///< on held-out settings, of the difference of the two cameras' columns [px]
};

/// Of settings_report.yaml. @throws CalibrationError naming the file and key
SettingsResiduals readSettingsResiduals(const std::string& path);

}  // namespace cortshift_stereo
