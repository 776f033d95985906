// Checks before reconstruction: pairs that cannot give a surface are refused with a reason a person can act on.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "cortshift_stereo/admission/verdict.hpp"
#include "cortshift_stereo/rectification/rectifier.hpp"

namespace cortshift_stereo {

/// Limits of the checks. Each default is written here and nowhere else.
struct PairLimits {
  double min_contrast = 4;             ///< [grey levels] standard deviation of the luminance
  double max_saturated_share = 0.25;   ///< [0...1] of the pixels
  double min_sharpness = 0.18;         ///< see ImageQuality
  double max_epipolar_residual = 1.0;  ///< [px]
  double min_coverage = 0.25;          ///< [0...1] of what the camera shows of the rectified left image, with a point
};

/// What one image looks like.
struct ImageQuality {
  double contrast;         ///< [grey levels] standard deviation of the luminance
  double saturated_share;  ///< [0...1] of the pixels have two channels at the upper end
  double sharpness;        ///< amplitude of detail of 2-4 px relative to detail of 8-16 px in the middle of the image:
                           ///< 0.5 ... 1 in focus, below 0.17 when blurred by 4 px
};

/// @param image  CV_8UC3
ImageQuality measureImage(const cv::Mat& image);

/// Blank, saturated or defocused, naming the side.
Findings checkImage(const ImageQuality& quality, const PairLimits& limits, const std::string& side);

/// A raw and a compressed image of one camera and stamp, CV_8UC3. JPEG loses little of what the eye sees; another
/// scene, or the image turned or shifted, is another image.
Findings checkSameImage(const cv::Mat& raw, const cv::Mat& decompressed, const std::string& side);

/// Vertical misalignment of corners matched in two dimensions. A swapped or mismatched pair, or a camera that has
/// moved since its calibration, is detected here, although matching along the rows would still find something.
struct EpipolarResidual {
  int matched = 0;               ///< corners found in both images
  double offset = 0;             ///< [px] median y_right - y_left
  double spread = 0;             ///< [px] median |y_right - y_left|
  double spread_if_swapped = 0;  ///< [px] the same if the left image were the right camera's and the other way round
};

/// @param disparity  CV_32FC1, NaN where invalid: where to start looking
EpipolarResidual measureEpipolarResidual(const RectifiedPair& pair, const cv::Mat& disparity,
                                         const Rectifier& rectifier);

}  // namespace cortshift_stereo
