// Brightness differences between the images: I2(x + w) = a(x) I1(x) + b(x), with a and b smooth.
#pragma once

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// Gain and offset per channel on a coarse grid.
class BrightnessMap {
 public:
  /// Fits the map between the images of a level under a flow that is right to a pixel or so.
  /// @param visible  0 where pixels have no match (CV_8UC1), or empty
  static BrightnessMap fit(const Level& level, const FlowPlanes& flow, const cv::Mat1b& visible, int threads);

  /// False where the change of brightness is too small to be told from the fit's own error: correcting it would cost
  /// more accuracy than it gains.
  bool significant() const { return root_mean_square_change_ > kLeastChange; }

  /// The first image as bright as the second. The map may have been fitted at another level.
  cv::Mat4f apply(const cv::Mat4f& image, int threads) const;

 private:
  static constexpr float kLeastChange = 0.75f / 255;

  cv::Mat4f gain_, offset_;  // per cell
  float root_mean_square_change_ = 0;
};

}  // namespace cortshift_flow
