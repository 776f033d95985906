// Pixels beside edges of depth: which of the two surfaces they lie on.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_stereo {

/// Corrects the rim of wrong disparity that matching by blocks leaves along edges of depth.
///
/// Each pixel beside an edge takes two tests. On which surface do the pixels around it lie that look like it (weighted
/// median, Ma et al. 2013)? At which of the two disparities does its neighbourhood look like the right image? If both
/// say the other surface, it moves there. If they contradict each other, it stays where the right image is clearly in
/// favour, as for thin things, and otherwise has no disparity.
///
/// @param disparity    CV_32FC1 [px], NaN where unknown
/// @param left, right  CV_8UC1, row-aligned, of that size
void settleDepthEdges(cv::Mat& disparity, const cv::Mat& left, const cv::Mat& right);

}  // namespace cortshift_stereo
