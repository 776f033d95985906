#include "cortshift_stereo/images/image_file.hpp"

#include <cstring>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace cortshift_stereo {
namespace {

constexpr int kUpright = 1;

/// Bytes of a file that may end anywhere; what lies behind the end reads as 0.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  std::size_t size() const { return size_; }
  unsigned byte(std::size_t at) const { return at < size_ ? data_[at] : 0U; }
  unsigned big16(std::size_t at) const { return byte(at) << 8 | byte(at + 1); }
  unsigned big32(std::size_t at) const { return big16(at) << 16 | big16(at + 2); }
  unsigned little16(std::size_t at) const { return byte(at + 1) << 8 | byte(at); }
  unsigned little32(std::size_t at) const { return little16(at + 2) << 16 | little16(at); }
  bool has(std::size_t at, const void* text, std::size_t length) const {
    return at + length <= size_ && std::memcmp(data_ + at, text, length) == 0;
  }
  Bytes from(std::size_t at) const { return at < size_ ? Bytes(data_ + at, size_ - at) : Bytes(data_, 0); }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
};

/// Of a TIFF header and its first directory, which EXIF data are too.
int orientationOfTiff(const Bytes& tiff) {
  const bool little = tiff.has(0, "II*\0", 4);
  if (!little && !tiff.has(0, "MM\0*", 4)) return kUpright;
  const auto read16 = [&](std::size_t at) { return little ? tiff.little16(at) : tiff.big16(at); };
  const std::size_t directory = little ? tiff.little32(4) : tiff.big32(4);
  const unsigned entries = read16(directory);
  constexpr unsigned kOrientation = 0x0112;
  constexpr std::size_t kEntryBytes = 12;
  for (std::size_t i = 0; i < entries; ++i) {
    const std::size_t entry = directory + 2 + kEntryBytes * i;
    if (entry + kEntryBytes > tiff.size()) break;
    if (read16(entry) == kOrientation) return static_cast<int>(read16(entry + 8));
  }
  return kUpright;
}

int orientationOfJpeg(const Bytes& file) {
  constexpr unsigned kStartOfScan = 0xffda, kApp1 = 0xffe1;
  for (std::size_t at = 2; at + 4 <= file.size();) {
    const unsigned marker = file.big16(at);
    if (marker < 0xff00 || marker == kStartOfScan) break;
    if (marker == kApp1 && file.has(at + 4, "Exif\0\0", 6)) return orientationOfTiff(file.from(at + 10));
    at += 2 + file.big16(at + 2);
  }
  return kUpright;
}

int orientationOfPng(const Bytes& file) {
  for (std::size_t at = 8; at + 12 <= file.size(); at += 12 + std::size_t{file.big32(at)})
    if (file.has(at + 4, "eXIf", 4)) return orientationOfTiff(file.from(at + 8));
  return kUpright;
}

}  // namespace

int exifOrientation(const std::vector<std::uint8_t>& file) {
  const Bytes bytes(file.data(), file.size());
  int orientation = kUpright;
  if (bytes.big16(0) == 0xffd8)
    orientation = orientationOfJpeg(bytes);
  else if (bytes.has(0, "\x89PNG\r\n\x1a\n", 8))
    orientation = orientationOfPng(bytes);
  else
    orientation = orientationOfTiff(bytes);
  return orientation >= 1 && orientation <= 8 ? orientation : kUpright;  // others have no meaning
}

cv::Mat decodeImage(const std::vector<std::uint8_t>& file, const std::string& name) {
  cv::Mat image;
  if (!file.empty()) image = cv::imdecode(file, cv::IMREAD_UNCHANGED | cv::IMREAD_IGNORE_ORIENTATION);
  if (image.empty()) throw ImageError(name + " is not readable as an image; replace it");
  if (image.depth() != CV_8U && image.depth() != CV_16U)
    throw ImageError(name + " does not hold whole numbers of 8 or 16 bits; save it as such");
  const int orientation = exifOrientation(file);
  if (orientation != kUpright)
    throw ImageError(
        name + " carries EXIF orientation " + std::to_string(orientation) +
        ", which asks for rotated pixels: images of a calibrated camera are never rotated. If its pixels are "
        "stored as the camera gave them, remove the tag (exiftool -Orientation= FILE); if not, save them so");
  return image;
}

cv::Mat readImageFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (!file) throw ImageError(path + " cannot be read; is the path right?");
  return decodeImage({bytes.begin(), bytes.end()}, path);
}

cv::Mat bgrOf(const cv::Mat& image) {
  cv::Mat bgr = image;
  if (image.channels() == 1) cv::cvtColor(image, bgr, cv::COLOR_GRAY2BGR);
  if (image.channels() == 4) cv::cvtColor(image, bgr, cv::COLOR_BGRA2BGR);
  return bgr;
}

}  // namespace cortshift_stereo
