#include "cortshift_stereo/images/bit_depth.hpp"

#include <algorithm>
#include <string>

namespace cortshift_stereo {
namespace {

constexpr int kContainer = 16;

/// Which values an image of 16 bits holds.
struct Use {
  int largest = 0;
  int together = 0;  ///< all values, or-ed
};

Use useOf(const cv::Mat& image) {
  Use use;
  if (image.depth() != CV_16U) return use;
  for (int y = 0; y < image.rows; ++y) {
    const auto* row = image.ptr<uint16_t>(y);
    for (int i = 0; i < image.cols * image.channels(); ++i) {
      use.largest = std::max<int>(use.largest, row[i]);
      use.together |= row[i];
    }
  }
  return use;
}

/// Of the depths that cameras have.
int bitsFor(int largest) {
  for (const int bits : {10, 12, 14})
    if (largest < 1 << bits) return bits;
  return kContainer;
}

std::string text(int bits, int largest) {
  return std::to_string(bits) + " bits (largest value " + std::to_string(largest) + ")";
}

/// Below, not even 8 bits are used, and nothing tells a dark image from one of few bits.
constexpr int kTooDark = 256;

/// Two cameras of one kind under one light differ by less than a factor of 16 (4 bits) in their brightest spot.
constexpr int kUnlike = 4;

int recognise(const Use& left, const Use& right) {
  const int largest = std::max(left.largest, right.largest);
  if (largest < kTooDark)
    throw ImageError("at most 8 bits in 16-bit images (largest value " + std::to_string(largest) +
                     "): the light is off, or the values have 8 bits; check the light and the exposure, or declare the "
                     "bits (image_bits)");
  if (left.largest > 0 && right.largest > 0 && std::abs(bitsFor(left.largest) - bitsFor(right.largest)) >= kUnlike)
    throw ImageError("unlike images: the left one uses " + text(bitsFor(left.largest), left.largest) +
                     " of 16, the right one " + text(bitsFor(right.largest), right.largest) +
                     ": set both cameras to one pixel format and exposure, or declare the bits (image_bits)");
  return bitsFor(largest);
}

}  // namespace

BitDepth::BitDepth(int declared) : declared_(declared) {
  if (declared != 0 && (declared < 8 || declared > kContainer))
    throw ImageError("image_bits = " + std::to_string(declared) +
                     " is not allowed; allowed is 8 ... 16, or 0 to recognise them");
}

void BitDepth::toEightBits(cv::Mat& left, cv::Mat& right) {
  if (left.depth() != CV_16U && right.depth() != CV_16U) return;
  const Use left_use = useOf(left), right_use = useOf(right);
  const int largest = std::max(left_use.largest, right_use.largest);
  int bits = declared_;
  if (declared_ == 0) {
    bits_ = bits = std::max(bits_, recognise(left_use, right_use));
  } else if (largest >= 1 << declared_) {
    const int below = (1 << (kContainer - declared_)) - 1;
    if (((left_use.together | right_use.together) & below) != 0)
      throw ImageError("values above what is declared: image_bits is " + std::to_string(declared_) +
                       ", but the largest value of the 16-bit images is " + std::to_string(largest) +
                       "; declare the bits that the camera uses");
    bits_ = bits = kContainer;  // in the upper bits
  } else {
    bits_ = bits;
  }
  const double scale = 255.0 / ((1 << bits) - 1);
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
