// hand_eye.yaml: the edge microscope -> left_optical with its date and errors.
#pragma once

#include <string>

#include "cortshift_stereo/calibration/calibration_verdict.hpp"
#include "cortshift_stereo/calibration/hand_eye/hand_eye.hpp"

namespace cortshift_stereo {

/// What goes into the file beside the calibration itself.
struct HandEyeReport {
  std::string date;    ///< ISO 8601, UTC
  std::string images;  ///< folder
  std::string camera;  ///< file of the camera's intrinsics
  Board board;
  HandEyeSettings settings;
  HandEyeCalibration calibration;
  CalibrationVerdict verdict;
};

/// @throws CalibrationError if the file cannot be written.
void writeHandEyeYaml(const std::string& path, const HandEyeReport& report);

/// The pose of left_optical in microscope [m].
/// @throws CalibrationError naming the file and key: missing or not YAML, other frames, or not a rotation.
cv::Affine3d readHandEyeYaml(const std::string& path);

/// What that pose is off by, from the residuals of its calibration: root mean square over the camera's axes.
struct HandEyeDeviation {
  double translation_sd = 0;  ///< [m]
  double rotation_sd = 0;     ///< [rad]
};

/// @throws CalibrationError naming the file and key: missing or not YAML, or without deviations (no file of
///         calibrate_hand_eye).
HandEyeDeviation readHandEyeDeviation(const std::string& path);

}  // namespace cortshift_stereo
