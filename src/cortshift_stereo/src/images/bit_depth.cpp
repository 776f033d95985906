#include "cortshift_stereo/images/bit_depth.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace cortshift_stereo {
namespace {

constexpr int kContainer = 16;

/// So many of an image's values may lie above its bits without telling of more. What is no light there is: hot pixels,
/// of which makers allow some ten in a million (one becomes nine where a Bayer pattern is taken out), and a counter
/// that a camera writes into its first pixels, some ten of 300 000 and more. What is light covers more, and the reverse
/// does no harm: of a picture of 2 million pixels, 200 become white, where a surface needs areas of texture.
constexpr double kStray = 1e-4;

std::size_t strayOf(const cv::Mat& image) {
  return static_cast<std::size_t>(kStray * static_cast<double>(image.total()) * image.channels());
}

/// Whether more values of an image of 16 bits than may be stray are as is asked. Ends as soon as that is clear.
template <typename Asked>
bool holdsMany(const cv::Mat& image, const Asked& asked) {
  if (image.depth() != CV_16U) return false;
  const std::size_t stray = strayOf(image);
  std::size_t found = 0;
  for (int y = 0; y < image.rows; ++y) {
    const auto* row = image.ptr<uint16_t>(y);
    unsigned in_row = 0;
    for (int i = 0; i < image.cols * image.channels(); ++i) in_row += asked(row[i]) ? 1U : 0U;
    found += in_row;
    if (found > stray) return true;
  }
  return false;
}

bool reaches(const cv::Mat& image, int value) {
  return holdsMany(image, [value](uint16_t v) { return v >= value; });
}

/// Of the depths that cameras have.
int bitsOf(const cv::Mat& image) {
  for (const int bits : {14, 12, 10})
    if (reaches(image, 1 << bits)) return bits == 14 ? kContainer : bits + 2;
  return 10;
}

/// "largest value 4095" of images of 16 bits, for a person who is to find it in them.
std::string largestOf(const std::vector<cv::Mat>& images) {
  int largest = 0, with_stray = 0;
  for (const cv::Mat& image : images) {
    if (image.depth() != CV_16U || image.empty()) continue;
    const cv::Mat flat = image.clone().reshape(1, 1);
    std::vector<uint16_t> values(flat.begin<uint16_t>(), flat.end<uint16_t>());
    const auto last = values.end() - 1 - static_cast<std::ptrdiff_t>(strayOf(image));
    std::nth_element(values.begin(), last, values.end());
    largest = std::max<int>(largest, *last);
    with_stray = std::max<int>(with_stray, *std::max_element(last, values.end()));
  }
  return std::to_string(largest) +
         (with_stray > largest ? ", but for a few stray ones up to " + std::to_string(with_stray) : "");
}

std::string text(int bits, const cv::Mat& image) {
  return std::to_string(bits) + " bits (largest value " + largestOf({image}) + ")";
}

/// Below, not even 8 bits are used, and nothing tells a dark image from one of few bits.
constexpr int kTooDark = 256;

/// Two cameras of one kind under one light differ by less than a factor of 16 (4 bits) in their brightest spot.
constexpr int kUnlike = 4;

int recognise(const cv::Mat& left, const cv::Mat& right) {
  if (!reaches(left, kTooDark) && !reaches(right, kTooDark))
    throw ImageError("at most 8 bits in 16-bit images (largest value " + largestOf({left, right}) +
                     "): the light is off, or the values have 8 bits; check the light and the exposure, or declare the "
                     "bits (image_bits)");
  const int left_bits = bitsOf(left), right_bits = bitsOf(right);
  if (reaches(left, 1) && reaches(right, 1) && std::abs(left_bits - right_bits) >= kUnlike)
    throw ImageError("unlike images: the left one uses " + text(left_bits, left) + " of 16, the right one " +
                     text(right_bits, right) +
                     ": set both cameras to one pixel format and exposure, or declare the bits (image_bits)");
  return std::max(left_bits, right_bits);
}

}  // namespace

BitDepth::BitDepth(int declared) : declared_(declared) {
  if (declared != 0 && (declared < 8 || declared > kContainer))
    throw ImageError("image_bits = " + std::to_string(declared) +
                     " is not allowed; allowed is 8 ... 16, or 0 to recognise them");
}

void BitDepth::toEightBits(cv::Mat& left, cv::Mat& right) {
  if (left.depth() != CV_16U && right.depth() != CV_16U) return;
  int bits = declared_;
  if (declared_ == 0) {
    bits_ = bits = std::max(bits_, recognise(left, right));
  } else if (declared_ < kContainer && (reaches(left, 1 << declared_) || reaches(right, 1 << declared_))) {
    const int below = (1 << (kContainer - declared_)) - 1;
    const auto in_lower_bits = [below](uint16_t v) { return (v & below) != 0; };
    if (holdsMany(left, in_lower_bits) || holdsMany(right, in_lower_bits))
      throw ImageError("values above what is declared: image_bits is " + std::to_string(declared_) +
                       ", but the largest value of the 16-bit images is " + largestOf({left, right}) +
                       "; declare the bits that the camera uses");
    bits_ = bits = kContainer;  // in the upper bits
  } else {
    bits_ = bits;
  }
  const double scale = 255.0 / ((1 << bits) - 1);  // stray values above saturate
  const bool same = left.data == right.data;
  cv::Mat eight;
  if (left.depth() == CV_16U) {
    left.convertTo(eight, CV_8U, scale);
    left = eight;
  }
  if (!same && right.depth() == CV_16U) {
    cv::Mat other;
    right.convertTo(other, CV_8U, scale);
    right = other;
  }
}

}  // namespace cortshift_stereo
