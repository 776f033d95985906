// How many bits cameras use of images with 16 bits a value.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo/images/image_file.hpp"

namespace cortshift_stereo {

/// Brings the pairs of one case to 8 bits, all by one scale.
///
/// Cameras of 10, 12 and 14 bits put their values into the lower bits of 16. The depth is the smallest of 10, 12, 14
/// and 16 bits that holds all but 0.01 % of the values (hot pixels, a counter in the first ones: they become white) of
/// both images and of every pair before: it may rise once when a dark beginning gives way to light, and never falls, so
/// that pictures do not flicker. Values in the upper bits reach the top, and 16 is right for them. A dark image passes
/// for one of fewer bits: it is scaled up, which changes brightness alone, and brightness is not measured with.
class BitDepth {
 public:
  /// @param declared  bits that the camera is known to use, 8 to 16; 0: recognised from the values
  /// @throws ImageError for another number
  explicit BitDepth(int declared = 0);

  /// Both images of a pair, CV_8U or CV_16U, to CV_8U; images of 8 bits stay as they are.
  /// @throws ImageError naming the bits: too dark to tell, two cameras of different depth, or values above what is
  ///         declared
  void toEightBits(cv::Mat& left, cv::Mat& right);

  /// One image alone.
  void toEightBits(cv::Mat& image) { toEightBits(image, image); }

  /// Bits in use; 0 where no image of 16 bits has come yet.
  int bits() const { return bits_; }

 private:
  int declared_;
  int bits_ = 0;
};

}  // namespace cortshift_stereo
