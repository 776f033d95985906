// Which mix of the colours disparities are measured on: learned from the pair itself.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace cortshift_stereo {

/// Grey value of either image: the sum of its colours (blue, green, red) by these weights.
struct ColourMix {
  cv::Vec3f left{1.0f / 3, 1.0f / 3, 1.0f / 3}, right = left;
};

/// The colours of one place of the tissue in both images, and how they change along the row.
struct ColourPair {
  cv::Point place;                    ///< [px] in the rectified left image
  cv::Vec3f left, right;              ///< blue, green, red [grey levels]
  cv::Vec3f left_slope, right_slope;  ///< over two pixels, of the same two places in both images
};

/// The mix on which both cameras agree and tissue stands out most from noise.
/// Each colour of the right camera is first made that of the left by a gain (white balance, exposure). Of all mixes
/// with weights from 0 to 1 that sum to 1, the one with the least expected error is taken: the error of a place goes
/// with (w'Nw / w'Sw)^1/2, where S is the change along the rows that both images show there (cross-covariance, block by
/// block) and N the change that only one of them shows (covariance of the difference, over the whole image). A match
/// that is a little wrong adds to N a part of S, which hardly moves the best w. Noise, a colour mosaic, the coarse
/// colours of JPEG, and light that only one camera sees are in N; a colour that is full shows no change, so its S is
/// small.
/// @param pairs  places all over the image; too few of them: the mean of the colours
ColourMix chooseMix(const std::vector<ColourPair>& pairs);

}  // namespace cortshift_stereo
