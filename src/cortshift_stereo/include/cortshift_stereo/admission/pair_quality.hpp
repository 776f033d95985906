// Checks before reconstruction: pairs that cannot give a surface are refused with a reason a person can act on.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_stereo/admission/row_agreement.hpp"
#include "cortshift_stereo/admission/verdict.hpp"

namespace cortshift_stereo {

/// Limits of the checks. Each default is written here and nowhere else.
struct PairLimits {
  double min_contrast = 4;             ///< [grey levels] standard deviation of the luminance
  double max_saturated_share = 0.25;   ///< [0...1] of the pixels
  double min_sharpness = 0.18;         ///< see ImageQuality
  double max_epipolar_residual = 1.0;  ///< [px] spread of the vertical gaps that no motion of the cameras explains
  double max_misalignment = 3.0;       ///< [px] vertical gaps by a turn of the right camera; up to here it is taken out
  double max_sharpness_ratio = 2.5;    ///< of ImageQuality::detail between the two images
  double min_coverage = 0.25;          ///< [0...1] of what the camera shows of the rectified left image, with a point
};

/// What one image looks like.
struct ImageQuality {
  double contrast;         ///< [grey levels] standard deviation of the luminance
  double saturated_share;  ///< [0...1] of the pixels have two channels at the upper end
  double sharpness;        ///< amplitude of detail of 2-4 px relative to detail of 8-16 px in the middle of the image:
                           ///< 0.5 ... 1 in focus, below 0.17 when blurred by 4 px
  double detail;           ///< amplitude of detail of 4-8 px relative to detail of 8-16 px, sensor noise taken off
};

/// @param image  CV_8UC3
ImageQuality measureImage(const cv::Mat& image);

/// Blank, saturated or defocused, naming the side.
Findings checkImage(const ImageQuality& quality, const PairLimits& limits, const std::string& side);

/// A raw and a compressed image of one camera and stamp, CV_8UC3. JPEG loses little of what the eye sees; another
/// scene, or the image turned or shifted, is another image.
Findings checkSameImage(const cv::Mat& raw, const cv::Mat& decompressed, const std::string& side);

/// What the rows of a pair say: swapped, no_match or epipolar where they refuse it.
struct RowVerdict {
  Findings findings;
  std::optional<cv::Vec3d> turn;  ///< [rad] of the right camera, worth taking out: see Rectifier::withRightTurned
};

/// Refuses a pair whose rows say that it is none or that its calibration is void; a turn that is smaller is to be taken
/// out. A limit counts as passed only where chance (four standard errors) does not explain it.
RowVerdict judgeRows(const RowAgreement& rows, const PairLimits& limits);

/// Refuses a pair of which one image is blurred against the other, naming the side.
Findings checkAlikeSharp(const ImageQuality& left, const ImageQuality& right, const PairLimits& limits);

/// Warns of a turn of the right camera that was taken out, and of one that rows tell but little of.
/// @param taken  [rad]
/// @param depth  [m] of the surface: a turn about the vertical axis by w changes it by depth^2 w / baseline
Findings warningsOfRows(const RowAgreement& rows, const cv::Vec3d& taken, const StereoModel& model, double depth);

}  // namespace cortshift_stereo
