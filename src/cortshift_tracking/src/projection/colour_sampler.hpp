// Colour of the rectified left image between its pixels.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_tracking {

class ColourSampler {
 public:
  /// @param image CV_8UC3
  /// @param step distance of neighbouring samples that will be taken [px]; detail finer than that is smoothed away
  ColourSampler(const cv::Mat& image, double step);

  /// Catmull-Rom interpolation at (column, row), clamped to 0...1; beyond the rim the rim's colour goes on.
  cv::Vec3f at(float column, float row) const;

 private:
  cv::Mat image_;  // CV_8UC3
};

}  // namespace cortshift_tracking
