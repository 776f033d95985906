// What a calibration of the stereo head leaves behind for people: how it was made and how good it is.
#pragma once

#include <optional>
#include <string>

#include "cortshift_stereo/calibration/calibration_verdict.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

namespace cortshift_stereo {

/// Everything that the report tells.
struct StereoReport {
  std::string date;    ///< ISO 8601, UTC
  std::string images;  ///< folder
  Board board;
  StereoCalibration calibration;    ///< rejected: all views that took no part
  std::optional<SetErrors> checks;  ///< on views that were kept out of the fit on purpose
  CalibrationVerdict verdict;
};

/// Now, as ISO 8601 in UTC.
std::string dateNow();

/// The report as YAML that people can read; lengths in millimetres where the key says _mm.
std::string reportText(const StereoReport& report);

/// The few lines that go into the head of each camera's file.
std::string remarksText(const StereoReport& report);

/// Write left.yaml, right.yaml and report.yaml into a folder, which is made if it is missing; of a useless calibration
/// the report alone.
/// @throws CalibrationError if something cannot be written.
void writeStereoCalibration(const std::string& folder, const StereoReport& report);

/// What the depths of a calibrated stereo head may be off by, as its report says.
struct StereoResiduals {
  double focal_deviation = 0;  ///< standard deviation of the focal length, relative to it: it stretches every depth
  double epipolar_rms = 0;     ///< row difference on held-out views [px]: what its disparities may be off by as well
  double focal_length = 0;     ///< [px]
  double baseline = 0;         ///< [m]
};

/// Of report.yaml. @throws CalibrationError naming the file and key
StereoResiduals readStereoResiduals(const std::string& path);

}  // namespace cortshift_stereo
