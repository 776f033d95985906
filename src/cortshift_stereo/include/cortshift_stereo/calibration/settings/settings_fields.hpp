// The deformation fields of both cameras, as calibrate_settings stores them.
#pragma once

#include <string>

#include "cortshift_stereo/calibration/settings/settings_warp.hpp"

namespace cortshift_stereo {

/// Fields of one calibration: one reference setting, one image size.
struct SettingsFields {
  SettingsWarp left;
  SettingsWarp right;

  const MicroscopeSetting& reference() const { return left.model().reference; }
  const cv::Size& size() const { return left.model().size; }
  bool cover(const MicroscopeSetting& setting) const { return left.covers(setting) && right.covers(setting); }

  /// @throws SettingNotCalibrated naming the setting and the calibrated range
  void requireCovered(const MicroscopeSetting& setting) const;
};

/// Reads settings_left.yaml and settings_right.yaml of a folder.
/// @throws CalibrationError naming the file and the remedy; also if the two do not belong together
SettingsFields readSettingsFields(const std::string& folder);

}  // namespace cortshift_stereo
