// Files of images: one reader for the sources, the calibration tools, reconstruct_pair and compressed messages.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace cortshift_stereo {

/// An image that cannot be used as it is. The message names it, what is wrong and the remedy.
class ImageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The EXIF orientation that a jpeg, png or tiff file carries: 1 (upright, also where there is none) to 8.
int exifOrientation(const std::vector<std::uint8_t>& file);

/// The pixels of a file as they are stored: CV_8U or CV_16U with 1, 3 (blue green red) or 4 channels.
///
/// An orientation other than 1 asks for rotated pixels, and some programs obey and others do not: a calibration made
/// with one kind and images read by the other would not fit, so it is refused.
/// @param name  what messages call the image
/// @throws ImageError not an image, other values than 8 or 16 bits, or an EXIF orientation other than 1
cv::Mat decodeImage(const std::vector<std::uint8_t>& file, const std::string& name);

/// The same from a file. @throws ImageError as above, or if it cannot be read
cv::Mat readImageFile(const std::string& path);

/// The same pixels as blue green red, in the depth that they have.
cv::Mat bgrOf(const cv::Mat& image);

}  // namespace cortshift_stereo
