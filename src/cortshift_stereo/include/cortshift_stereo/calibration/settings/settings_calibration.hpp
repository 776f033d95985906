// Deformation fields of one camera from views of boards that stay where they are while the microscope's magnification
// and focal length change (Ji et al., MICCAI 2014).
#pragma once

#include <string>
#include <vector>

#include "cortshift_stereo/calibration/board.hpp"
#include "cortshift_stereo/calibration/settings/settings_warp.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

namespace cortshift_stereo {

/// The same corners of a board at the reference and at another setting.
struct SettingView {
  std::string name;  ///< what people call the view: its image
  MicroscopeSetting setting;
  Corners at_setting;    ///< [px]
  Corners at_reference;  ///< [px]
};

/// How well the field fits one view.
struct SettingResidual {
  std::string name;
  MicroscopeSetting setting;
  double rms = 0;       ///< in the view's own image [px]
  double held_out = 0;  ///< in pixels of the reference image, fitted without this setting; NaN at the corners of the
                        ///< hull of settings, which only they span [px]
};

struct SettingsCalibration {
  SettingsWarp warp;
  int image_degree = 0;                    ///< of the polynomial in image coordinates
  std::pair<int, int> setting_degrees;     ///< in magnification and in focal length
  double rms = 0;                          ///< over all views [px]
  double held_out_rms = 0;                 ///< over the settings that the others surround [px of the reference image]
  std::vector<SettingResidual> residuals;  ///< one per view used
  std::vector<RejectedView> rejected;
};

constexpr double kLargestHeldOutRms = 0.5;  ///< [px]

/// Fit the field. Degrees are chosen by the error on settings that are held out in turn; views that disagree with the
/// others are left out and named.
///
/// The camera's centre of projection being the same at all settings, the field is right for any scene. Where it moves
/// with zoom or focus, the field is right in the plane of the board only, and off by parallax before and behind it:
/// use a board at the working distance.
/// @param size       of the images [px]
/// @param reference  the setting of the reference images
/// @throws CalibrationError naming the remedy: corners that do not pair up, too few settings (at least one must lie
///         between others), or a field that does not predict held-out settings to kLargestHeldOutRms.
SettingsCalibration calibrateSettings(const cv::Size& size, const MicroscopeSetting& reference,
                                      const std::vector<SettingView>& views);

}  // namespace cortshift_stereo
