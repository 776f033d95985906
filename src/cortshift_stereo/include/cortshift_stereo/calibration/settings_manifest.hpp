// Which image shows which board at which setting of the microscope.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/settings_calibration.hpp"

namespace cortshift_stereo {

/// One pair of images at one setting.
struct ManifestView {
  MicroscopeSetting setting;
  std::string left, right;  ///< paths
};

/// One board that never moved while its pairs were taken.
struct ManifestBoard {
  Board board;
  std::string left, right;  ///< paths of the pair at the reference setting
  std::vector<ManifestView> views;
};

struct SettingsManifest {
  MicroscopeSetting reference;
  std::vector<ManifestBoard> boards;
};

/// Read a manifest:
///
///     reference: {magnification: 1.0, focal_length: 0.3}   # focal length in metres
///     boards:
///       - board: 9x6                                       # inner corners
///         reference: {left: a_left.png, right: a_right.png}
///         views:
///           - {magnification: 0.8, focal_length: 0.25, left: b_left.png, right: b_right.png}
///
/// Paths are relative to the manifest's folder.
/// @throws CalibrationError naming the file and the entry: not YAML, a key missing or unknown, a value out of range, or
///         no boards or views.
SettingsManifest readSettingsManifest(const std::string& path);

/// The corners that one manifest's images show.
struct SettingViews {
  cv::Size size;  ///< of every image [px]
  std::vector<SettingView> left, right;
  std::vector<RejectedView> rejected;  ///< images in which the board was not found
};

/// Find the boards in all images.
/// @param progress  called with a share (0...1) as the work goes on; may be empty
/// @throws CalibrationError naming the file: an image that cannot be read or has another size, or no board in an image
///         at the reference setting.
SettingViews findSettingViews(const SettingsManifest& manifest, const std::function<void(double)>& progress = {});

/// Write settings_left.yaml, settings_right.yaml and settings_report.yaml into a folder, which is made if missing.
/// @param date     ISO 8601
/// @param rejected  images in which the board was not found
/// @throws CalibrationError if something cannot be written.
void writeSettingsCalibration(const std::string& folder, const std::string& date, const SettingsCalibration& left,
                              const SettingsCalibration& right, const std::vector<RejectedView>& rejected);

}  // namespace cortshift_stereo
