// Wet highlights: mirrored light of the lamp. It hides the tissue, and its place changes with the place of the camera.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_stereo {

/// Where a raw image does not show the tissue itself. Both are empty where nothing is saturated.
struct Highlights {
  cv::Mat saturated;  ///< CV_8UC1, 255 on saturated pixels and beside them: nothing can be seen
  cv::Mat glow;       ///< CV_8UC1, 255 there and on the glow around: what is seen there seems to lie at another depth
};

/// The mirror image of a lamp is not at the depth of the surface, so its unsaturated glow gives every matcher a wrong
/// depth.
/// Glow is what lies near saturated pixels and is both brighter and less coloured than its surroundings by more than
/// their own spread (dichromatic reflection, Shafer 1985: a highlight adds the lamp's white to the tissue's colour).
/// @param bgr  CV_8UC3
Highlights findHighlights(const cv::Mat& bgr);

}  // namespace cortshift_stereo
