// Whether the rows of a rectified pair agree, and if not, by which motion of the right camera.
#pragma once

#include <algorithm>
#include <opencv2/core.hpp>
#include <vector>

#include "cortshift_stereo/rectification/rectifier.hpp"

namespace cortshift_stereo {

/// A piece of tissue found in both rectified images by matching in two dimensions.
struct MatchedPoint {
  cv::Point2d left, right;  ///< [px]
  double sd_row;            ///< [px] standard error of right.y - left.y, from the residual and the gradients
};

/// Points whose vertical position is really measured: the structure tensor of their surroundings holds rows down,
/// glints and saturation are left out, gain and offset between the cameras are fitted, the two images resemble one
/// another, and matching back from right to left returns.
/// @param disparity  CV_32FC1, NaN where unknown: where to start looking
std::vector<MatchedPoint> matchPoints(const RectifiedPair& pair, const cv::Mat& disparity);

/// A value with its standard error.
struct Estimate {
  double value = 0, sd = 0;
  /// The smallest size it has but for chance: nearer to 0 by `sds` standard errors.
  double surely(double sds) const {
    return value > 0 ? std::max(0.0, value - sds * sd) : std::min(0.0, value + sds * sd);
  }
};

/// The vertical gaps of matched points as a motion of the right camera.
/// With u, v the right point's rectified direction and f the focal length, a rotation vector w and a scale s give
/// gap = f (-w_x (1 + v^2) + w_z u + w_y u v + s v) to first order. A shift of rows is a turn about x, one of columns a
/// turn about y, which rows hardly tell: only by u v.
struct RowAgreement {
  int matched = 0;          ///< points
  Estimate turn_x, turn_z;  ///< [rad] of the right camera in its rectified frame, against the calibration
  Estimate turn_y;          ///< [rad] as far as rows tell
  Estimate scale;           ///< along the rows' normal
  Estimate misalignment;    ///< [px] root mean square over the points of the gap that the turns about x and z make
  double offset = 0;        ///< [px] median of y_right - y_left
  double spread = 0;        ///< [px] robust deviation of the gaps from the motion, beyond their own standard errors
  double spread_as_is = 0;  ///< [px] median |gap|
  double spread_if_swapped = 0;  ///< [px] the same if the left image were the right camera's and the other way round
};

/// Robust weighted least squares (Tukey's biweight); standard errors from the residuals.
RowAgreement agreementOf(const std::vector<MatchedPoint>& points, const Rectifier& rectifier);

}  // namespace cortshift_stereo
