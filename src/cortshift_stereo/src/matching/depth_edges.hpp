// Pixels beside edges of depth: which of the two surfaces they lie on.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_stereo {

/// Mends the rim of wrong disparity that matching by blocks leaves along edges of depth.
///
/// Beside an edge each pixel is asked twice: which surface do the pixels around it that look alike lie on (weighted
/// median, Ma et al. 2013), and at which of the two disparities does its neighbourhood look like the right image. Where
/// both say the other surface it moves there; where they contradict one another it stays if the right image speaks
/// plainly, as for thin things, and else has no disparity.
///
/// @param disparity    CV_32FC1 [px], NaN where unknown
/// @param left, right  CV_8UC1, row-aligned, of that size
void settleDepthEdges(cv::Mat& disparity, const cv::Mat& left, const cv::Mat& right);

}  // namespace cortshift_stereo
