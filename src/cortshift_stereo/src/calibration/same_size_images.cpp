#include "calibration/same_size_images.hpp"

#include "cortshift_stereo/calibration/board.hpp"

namespace cortshift_stereo {
namespace {

std::string describe(const cv::Size& size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

}  // namespace

cv::Mat SameSizeImages::read(const std::string& path) {
  cv::Mat image = readGreyImage(path);
  if (first_.empty()) {
    first_ = path;
    size_ = image.size();
  }
  if (image.size() != size_)
    throw CalibrationError(path + " is " + describe(image.size()) + " but " + first_ + " is " + describe(size_) +
                           "; all images must come from the same cameras at one size");
  return image;
}

}  // namespace cortshift_stereo
