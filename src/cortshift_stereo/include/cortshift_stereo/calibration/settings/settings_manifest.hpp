// Which image shows which board at which setting of the microscope.
#pragma once

#include <string>
#include <vector>

#include "cortshift_stereo/calibration/board.hpp"
#include "cortshift_stereo/calibration/settings/settings_warp.hpp"

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

}  // namespace cortshift_stereo
