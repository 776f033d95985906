// Raw stereo images to row-aligned ones, in one resampling.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo/calibration/settings/settings_fields.hpp"
#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

struct ColourMix;

/// Both images as ideal cameras with parallel axes would have taken them.
struct RectifiedPair {
  cv::Mat left;          ///< CV_32FC1 grey levels, slightly blurred, sampled to a fraction of a grey level
  cv::Mat right;         ///< the same
  cv::Mat left_sharp;    ///< CV_8UC1 luminance as it comes, highlights painted over, for matching by pixels
  cv::Mat right_sharp;   ///< the same
  cv::Mat left_colour;   ///< CV_8UC3 blue green red
  cv::Mat left_seen;     ///< CV_8UC1, 255 where the raw image has a pixel that is not saturated
  cv::Mat right_seen;    ///< the same
  cv::Mat left_usable;   ///< CV_8UC1, 255 where it shows the tissue itself, not the glow of a highlight either
  cv::Mat right_usable;  ///< the same
  bool has_highlights;   ///< either image
};

/// Rectification by each camera's own K, D, R and P (the two principal points may differ).
class Rectifier {
 public:
  /// For images taken at the setting that the model was calibrated at.
  /// @throws CalibrationError if the model is not valid
  explicit Rectifier(const StereoModel& model);

  /// For images taken at another setting of the microscope: one resampling rectifies them and turns them into what the
  /// calibrated setting would have given (Ji et al. 2014, section 2.3).
  /// @throws CalibrationError if the model is not valid or the fields are for another image size; SettingNotCalibrated
  Rectifier(const StereoModel& model, const SettingsFields& fields, const MicroscopeSetting& setting);

  /// The same for a right camera that has turned since its calibration.
  /// @param turn  rotation vector [rad] that takes directions of the true rectified right frame to those of this one
  Rectifier withRightTurned(const cv::Vec3d& turn) const;

  const StereoModel& model() const { return model_; }

  /// All of a pair; its grey levels are the mean of the colours.
  /// @param left, right  CV_8UC3 raw images of the calibrated size
  /// @throws std::invalid_argument otherwise
  RectifiedPair rectify(const cv::Mat& left, const cv::Mat& right) const;

  /// What matching by pixels needs: all but `left` and `right`. The rest as above.
  RectifiedPair rectifySharp(const cv::Mat& left, const cv::Mat& right) const;

  /// The grey levels `left` and `right` of a pair that was matched: mixed from the colours so that both cameras agree
  /// and tissue stands out most from noise.
  /// @param disparity  CV_32FC1 [px], NaN where nothing was matched
  void mixGrey(const cv::Mat& left, const cv::Mat& right, const cv::Mat& disparity, RectifiedPair& pair) const;

  /// CV_32FC2: position [px] of each pixel of a rectified image in the raw image at the calibrated setting.
  const cv::Mat& leftMap() const { return left_.calibrated_map; }
  const cv::Mat& rightMap() const { return right_.calibrated_map; }

  /// Share of the rectified left image that the raw one shows, 0...1.
  double leftShare() const;

 private:
  struct Side {
    cv::Mat calibrated_map;
    cv::Mat map;       // CV_32FC2 position of each rectified pixel in the raw image [px]; outside where there is none
    cv::Mat inside;    // CV_8UC1 255 where the whole interpolation kernel lies in the raw image
    cv::Mat map_near;  // CV_16SC2 and CV_16UC1: the same in OpenCV's fixed point, for the colours
    cv::Mat map_share;
  };
  static void finishSide(Side& side);
  static Side makeSide(const CameraModel& camera, const SettingsWarp* warp, const MicroscopeSetting& setting);
  struct RectifiedSide {
    cv::Mat &sharp, &seen, &usable;
  };
  /// @returns whether it has highlights
  static bool rectifySide(const cv::Mat& raw, const Side& side, const RectifiedSide& out);
  void mixGrey(const cv::Mat& left, const cv::Mat& right, const ColourMix& mix, RectifiedPair& pair) const;

  StereoModel model_;
  Side left_;
  Side right_;
};

}  // namespace cortshift_stereo
