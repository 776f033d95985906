// A photograph as the colour of the tissue.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo_phantom/phantom_case.hpp"

namespace cortshift_stereo_phantom {

class TissuePicture {
 public:
  /// @throws PhantomCaseError where the file cannot be read as a picture
  explicit TissuePicture(const PictureSettings& settings);

  /// Albedo at a material point [m]: blue green red, 0...1, interpolated by cubic convolution (Keys 1981, a = -1/2).
  cv::Vec3f colour(double x, double y) const;

 private:
  cv::Mat_<cv::Vec3f> values_;
  Eigen::Vector2d centre_;
  double cosine_, sine_, pixels_per_metre_;
};

}  // namespace cortshift_stereo_phantom
