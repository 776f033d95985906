// Images that must all have one size.
#pragma once

#include <opencv2/core.hpp>
#include <string>

namespace cortshift_stereo {

/// Reads images as 8-bit grey; the first one sets the size.
class SameSizeImages {
 public:
  /// @throws CalibrationError naming the file: missing, not an image, or of another size than the first.
  cv::Mat read(const std::string& path);

  cv::Size size() const { return size_; }  ///< [px]; empty before the first image

 private:
  std::string first_;
  cv::Size size_;
};

}  // namespace cortshift_stereo
