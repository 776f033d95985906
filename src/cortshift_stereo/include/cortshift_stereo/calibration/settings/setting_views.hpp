// The boards in the images that a manifest lists.
#pragma once

#include <functional>
#include <vector>

#include "cortshift_stereo/calibration/settings/settings_calibration.hpp"
#include "cortshift_stereo/calibration/settings/settings_manifest.hpp"

namespace cortshift_stereo {

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

}  // namespace cortshift_stereo
