#include "sources/folder_source.hpp"

#include <algorithm>
#include <opencv2/core/utils/filesystem.hpp>
#include <opencv2/imgcodecs.hpp>  // haveImageReader

namespace cortshift_stereo {
namespace {

std::string fileName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

cv::Mat readImage(const std::string& path, const cv::Size& size) {
  const cv::Mat image = bgrOf(readImageFile(path));
  if (image.size() != size)
    throw SourceError(path + " has " + std::to_string(image.cols) + " x " + std::to_string(image.rows) +
                      " pixels, its calibration is for " + std::to_string(size.width) + " x " +
                      std::to_string(size.height));
  return image;
}

}  // namespace

FolderSource::FolderSource(const std::string& folder, bool loop, const StereoModel& calibration, Clock clock,
                           int image_bits)
    : folder_(folder), loop_(loop), calibration_(calibration), clock_(std::move(clock)), depth_(image_bits) {
  if (!cv::utils::fs::isDirectory(folder)) throw std::invalid_argument("folder '" + folder + "' is not there");
  std::vector<cv::String> paths;
  cv::utils::fs::glob(folder, "*", paths);
  std::vector<std::string> names;
  for (const std::string& path : paths)
    if (cv::haveImageReader(path)) names.push_back(fileName(path));
  std::sort(names.begin(), names.end());
  for (const std::string& name : names) {
    const std::size_t left = name.rfind("left"), right = name.rfind("right");
    if (left == std::string::npos && right == std::string::npos) continue;
    std::string partner = name;
    if (left != std::string::npos)
      partner.replace(left, 4, "right");
    else
      partner.replace(right, 5, "left");
    if (!std::binary_search(names.begin(), names.end(), partner))
      throw std::invalid_argument(folder + "/" + name + " has no partner " + partner);
    if (left != std::string::npos) pairs_.push_back({name, partner});
  }
  if (pairs_.empty())
    throw std::invalid_argument("folder '" + folder + "' holds no images named ...left... and ...right...");
}

StereoPair FolderSource::fire() {
  if (next_ == pairs_.size()) {
    if (!loop_) throw SourceError("all " + std::to_string(pairs_.size()) + " pairs of " + folder_ + " have been taken");
    next_ = 0;
  }
  const Names& names = pairs_[next_++];
  StereoPair pair;
  try {
    pair.left = readImage(folder_ + "/" + names.left, calibration_.left.size);
    pair.right = readImage(folder_ + "/" + names.right, calibration_.right.size);
    depth_.toEightBits(pair.left, pair.right);
  } catch (const ImageError& error) {
    throw SourceError(error.what());
  }
  pair.stamp = clock_();
  return pair;
}

}  // namespace cortshift_stereo
