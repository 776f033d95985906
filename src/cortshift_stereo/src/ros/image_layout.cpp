#include "cortshift_stereo/ros/image_layout.hpp"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/endian/conversion.hpp>
#include <cstdlib>

#include "cortshift_stereo/ros/conversions.hpp"

namespace cortshift_stereo {
namespace {

constexpr bool kBigEndianHost = boost::endian::order::native == boost::endian::order::big;

/// So many rows, spread over the image, tell how smooth it is.
constexpr int kRows = 64;

/// Phantom pictures of 10 to 16 bits, light and dark, down to pure noise: in the right order they are at most 1.02
/// times as rough as exchanged; in the wrong order 1.5 times and more, from half the full scale on (image_layout_test).
/// Values of one byte's worth are as rough both ways, and either reading gives the same picture.
constexpr double kPlainlyRougher = 1.25;

constexpr double kPicture = 0.7;  // as rough at most as this is what shows something: noise is 1

uint16_t exchanged(uint16_t value) { return static_cast<uint16_t>(value << 8 | value >> 8); }

}  // namespace

void requireWhole(const sensor_msgs::Image& image) {
  if (uint64_t{image.step} * image.height > image.data.size())
    throw MessageError(std::to_string(image.data.size()) + " bytes of data are too few for " +
                       std::to_string(image.height) + " rows of " + std::to_string(image.step));
}

bool isSwapped(const sensor_msgs::Image& image) {
  return (image.is_bigendian != 0) != kBigEndianHost && sensor_msgs::image_encodings::bitDepth(image.encoding) == 16;
}

sensor_msgs::Image withBytesSwapped(const sensor_msgs::Image& image) {
  requireWhole(image);
  sensor_msgs::Image out = image;
  for (std::size_t y = 0; y < image.height; ++y) {
    uint8_t* row = out.data.data() + y * image.step;
    for (std::size_t i = 0; i + 1 < image.step; i += 2) std::swap(row[i], row[i + 1]);
  }
  out.is_bigendian = kBigEndianHost;
  return out;
}

Roughness roughnessOf(const cv::Mat& image, const std::string& encoding) {
  if (image.depth() != CV_16U) return {};
  const int channels = image.channels();
  const int next = sensor_msgs::image_encodings::isBayer(encoding) ? 2 : 1;
  if (image.cols < 2 * next || image.rows < 1) return {};
  const int half_width = image.cols / 4 * 2, half_height = image.rows / 4 * 2;  // even: of one colour
  double near[2] = {0, 0}, far[2] = {0, 0};
  for (int y = 0; y < image.rows; y += std::max(1, image.rows / kRows)) {
    const auto* row = image.ptr<uint16_t>(y);
    const auto* other = image.ptr<uint16_t>((y + half_height) % image.rows);
    for (int x = 0; x + next < image.cols; ++x)
      for (int c = 0; c < channels; ++c) {
        const uint16_t a = row[x * channels + c], b = row[(x + next) * channels + c],
                       d = other[(x + half_width) % image.cols * channels + c];
        near[0] += std::abs(a - b);
        far[0] += std::abs(a - d);
        near[1] += std::abs(exchanged(a) - exchanged(b));
        far[1] += std::abs(exchanged(a) - exchanged(d));
      }
  }
  if (far[0] == 0) return {};  // then of the exchanged values too
  return {near[0] / far[0], near[1] / far[1]};
}

void requireByteOrder(const cv::Mat& image, const std::string& encoding, const std::string& name) {
  const Roughness roughness = roughnessOf(image, encoding);
  if (roughness.as_is > kPlainlyRougher * roughness.swapped && roughness.swapped < kPicture)
    throw MessageError(name +
                       ": its 16-bit values are noise as they are, and a picture with their two bytes exchanged: the "
                       "bytes are in the other order than is_bigendian of the camera's image says; have its driver "
                       "set is_bigendian right");
}

}  // namespace cortshift_stereo
