// Which mix of the colours disparities are measured on: learned from the pair itself.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace cortshift_stereo {

/// Grey value of either image: the sum of its colours (blue, green, red) by these weights, and an offset.
struct ColourMix {
  cv::Vec3f left{1.0f / 3, 1.0f / 3, 1.0f / 3}, right = left;
  float right_offset = 0;  ///< [grey levels]; the left one has none
};

/// The colours of one place of the tissue in both images, and how they change along the row.
struct ColourPair {
  cv::Point place;                    ///< [px] in the rectified left image
  cv::Vec3f left, right;              ///< blue, green, red [grey levels]
  cv::Vec3f left_slope, right_slope;  ///< over two pixels, of the same two places in both images
};

/// The mix on which both cameras agree and tissue stands out most from noise.
/// Each colour of the right camera is first made that of the left by a gain and an offset (white balance, exposure,
/// black level). Of all mixes with weights from 0 to 1 that sum to 1, the one is taken that has the most change along
/// the rows that both images show (their cross-covariance S) for the change that only one shows (N, covariance of the
/// difference): the greatest w'Sw / w'Nw. A match that is a little wrong adds a part of S to N, which leaves the best w
/// where it is. Noise, a colour mosaic, the coarse colours of JPEG, and light that only one camera sees are in N.
/// @param pairs  places all over the image; too few of them: the mean of the colours
ColourMix chooseMix(const std::vector<ColourPair>& pairs);

}  // namespace cortshift_stereo
