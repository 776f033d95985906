// Holes in images, filled from around them.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_stereo {

/// Fills unknown values from known ones at growing distances, smoothly.
/// @param values  CV_32FC1; what is unknown may be NaN
/// @param known   CV_8UC1, 255 where known
cv::Mat fillUnknown(const cv::Mat& values, const cv::Mat& known);

}  // namespace cortshift_stereo
