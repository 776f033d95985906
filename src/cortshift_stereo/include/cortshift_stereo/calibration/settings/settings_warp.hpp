// Images taken at any magnification and focal length as if taken at the reference setting (Ji et al. 2014, section 2.3;
// Ji et al., MICCAI 2014).
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// What the surgeon turns.
struct MicroscopeSetting {
  double magnification = 0;  ///< as the microscope reports it
  double focal_length = 0;   ///< [m]

  /// Whether a microscope can be set so: both finite and positive.
  bool possible() const;
};

/// "magnification 1.25, focal length 300 mm"
std::string describe(const MicroscopeSetting& setting);

/// The setting lies outside the calibrated ones. The message gives both.
class SettingNotCalibrated : public CalibrationError {
 public:
  using CalibrationError::CalibrationError;
};

/// The numbers of a deformation field of one camera. A pixel p of the reference image is seen at setting S at
///
///     p + sum_k sum_j c_kj x^a_k y^b_k s^m_j t^n_j
///
/// with x, y = (p - centre) / radius and s, t the differences of magnification and optical power (1 / focal length)
/// from the reference, divided by their scales. Power, not length, since the image's scale is nearly proportional to
/// it. Every term has m + n > 0, so that the field vanishes at the reference exactly.
struct WarpModel {
  cv::Size size;  ///< of the images [px]
  MicroscopeSetting reference;
  cv::Point2d setting_scale;  ///< largest difference of magnification and power [1/m] from the reference; 1 if none
  cv::Point2d centre;         ///< [px]
  double radius = 0;          ///< [px]
  std::vector<std::pair<int, int>> image_powers;    ///< a_k, b_k
  std::vector<std::pair<int, int>> setting_powers;  ///< m_j, n_j
  std::vector<cv::Vec2d> coefficients;              ///< c_kj at k * setting_powers.size() + j [px]
  std::vector<MicroscopeSetting> calibrated;        ///< all settings that took part, the reference among them
  std::vector<cv::Point2d> region;  ///< convex outline of the calibrated part of the reference image [px]

  /// s and t of a setting.
  cv::Point2d scaled(const MicroscopeSetting& setting) const;

  /// @throws CalibrationError if counts do not agree or a number cannot be right.
  void validate() const;
};

/// The deformation field of one camera at run time.
class SettingsWarp {
 public:
  /// @throws CalibrationError if the model is not valid.
  explicit SettingsWarp(WarpModel model);

  const WarpModel& model() const { return model_; }

  /// Inside the convex hull of the calibrated settings over magnification and optical power.
  bool covers(const MicroscopeSetting& setting) const;

  /// @throws SettingNotCalibrated naming the setting and the calibrated range if the setting is not covered.
  void requireCovered(const MicroscopeSetting& setting) const;

  /// "magnification 0.7 to 1.4, focal length 250 to 350 mm"
  std::string calibratedRange() const;

  /// Where a pixel of the reference image is seen at a setting [px]. @throws SettingNotCalibrated
  cv::Point2d toSetting(const cv::Point2d& at_reference, const MicroscopeSetting& setting) const;

  /// Where a pixel seen at a setting would be in the reference image [px]. @throws SettingNotCalibrated, and
  /// CalibrationError if no pixel of the reference image is seen there.
  cv::Point2d toReference(const cv::Point2d& at_setting, const MicroscopeSetting& setting) const;

  /// Carry a map into the reference image on into the image at a setting, so that one cv::remap does both.
  ///
  /// @param map_to_reference  CV_32FC2: for each pixel of the result its place in the raw reference image [px]
  /// @return CV_32FC2 of the same size: its place in the raw image at the setting [px]; outside the calibrated part of
  ///         the image (-1, -1), which cv::remap fills with its constant border
  /// @throws SettingNotCalibrated; std::invalid_argument if the map has another type
  cv::Mat compose(const cv::Mat& map_to_reference, const MicroscopeSetting& setting) const;

 private:
  /// Coefficients of the image polynomial at a setting, one per image power [px].
  std::vector<cv::Vec2d> fieldAt(const MicroscopeSetting& setting) const;
  cv::Vec2d displacement(const std::vector<cv::Vec2d>& field, const cv::Point2d& at_reference) const;

  WarpModel model_;
  std::vector<cv::Point2d> hull_;  ///< of the calibrated settings, scaled; fewer than 3 if they lie on a line
};

/// Read one camera's field. @throws CalibrationError naming file, key and remedy.
SettingsWarp readSettingsWarp(const std::string& path);

/// Write one camera's field so that it reads back exactly.
/// @param remarks  lines for people (date, residuals), written as comments at the top
/// @throws CalibrationError if the file cannot be written.
void writeSettingsWarp(const std::string& path, const SettingsWarp& warp, const std::string& remarks);

}  // namespace cortshift_stereo
