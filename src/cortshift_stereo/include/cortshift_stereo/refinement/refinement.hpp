// The sub-pixel part of the disparity, free of pixel locking.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo/rectification/rectifier.hpp"

namespace cortshift_stereo {

struct RefinedDisparity {
  cv::Mat disparity;  ///< CV_32FC1 x_left - x_right [px]; also where the start was unknown
  cv::Mat deviation;  ///< CV_32FC1 [px] standard deviation to expect; large far from any known start
};

/// Variational refinement of a disparity that is right to about a pixel.
///
/// Minimises over the disparity d the sum of w (left(x) - a right(x - d) - b)^2 / noise^2 and of mu psi(|Hess d|), by
/// Gauss-Newton steps on cells of pixels, from coarse to fine. The second-order penalty favours planes of any slant
/// over steps; psi is robust, so that edges of depth stay. Gain a and offset b vary slowly over the image. The noise is
/// measured from the residual itself. w lets go of outliers and of edges so strong that interpolation error exceeds
/// noise there.
///
/// @param pair   rectified images
/// @param start  CV_32FC1 [px], NaN where unknown
RefinedDisparity refineDisparity(const RectifiedPair& pair, const cv::Mat& start);

/// Confidence 0...1 of a deviation [px]: 1 / (1 + (deviation / 0.1 px)^2), so 0.5 at a tenth of a pixel; 0 for NaN.
cv::Mat confidenceOf(const cv::Mat& deviation);

/// The other way round: deviation [px] of a confidence > 0.
double deviationOf(double confidence);

}  // namespace cortshift_stereo
