// The order of the bytes of 16-bit images, on phantom pictures of cameras of few and many bits.
#include "cortshift_stereo/ros/image_layout.hpp"

#include <cv_bridge/cv_bridge.h>
#include <gmock/gmock.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace cortshift_stereo {
namespace {

/// Light on the left sensor of the phantom, CV_32FC3, 1 is full scale.
const cv::Mat& phantomLight() {
  using namespace cortshift_stereo_phantom;
  static const cv::Mat light = sensorLight(
      PhantomScene(loadPhantomCase(std::string(CORTSHIFT_TEST_DIR) + "/small_phantom.yaml")), 0, Side::kLeft);
  return light;
}

/// What a camera of so many bits gives of it. @param noise standard deviation, of full scale
cv::Mat taken(int bits, double noise, double gain = 1) {
  cv::Mat noisy(phantomLight().size(), CV_32FC3), out;
  cv::RNG(17).fill(noisy, cv::RNG::NORMAL, 0, noise);
  noisy += phantomLight() * gain;
  cv::Mat(cv::min(cv::max(noisy, 0), 1)).convertTo(out, CV_16U, (1 << bits) - 1);
  return out;
}

cv::Mat grey(const cv::Mat& bgr) {
  cv::Mat out;
  cv::cvtColor(bgr, out, cv::COLOR_BGR2GRAY);
  return out;
}

/// bayer_rggb16
cv::Mat mosaic(const cv::Mat& bgr) {
  cv::Mat out(bgr.size(), CV_16U);
  for (int y = 0; y < bgr.rows; ++y)
    for (int x = 0; x < bgr.cols; ++x) out.at<uint16_t>(y, x) = bgr.at<cv::Vec<uint16_t, 3>>(y, x)[2 - y % 2 - x % 2];
  return out;
}

sensor_msgs::Image message(const cv::Mat& pixels, const std::string& encoding) {
  return *cv_bridge::CvImage({}, encoding, pixels).toImageMsg();
}

/// The same picture with its bytes the other way round, and said so.
sensor_msgs::Image bigEndian(const sensor_msgs::Image& image) {
  sensor_msgs::Image out = withBytesSwapped(image);
  out.is_bigendian = 1;
  return out;
}

template <typename Image>
std::string refusal(const Image& image) {
  try {
    bgrFromImage(image);
  } catch (const MessageError& error) {
    return error.what();
  }
  return "";
}

/// A picture in every encoding of 16 bits that is read.
std::vector<sensor_msgs::Image> encodingsOf(const cv::Mat& bgr) {
  cv::Mat bgra;
  cv::cvtColor(bgr, bgra, cv::COLOR_BGR2BGRA);
  return {message(grey(bgr), "mono16"), message(bgr, "bgr16"), message(bgr, "rgb16"), message(bgra, "bgra16"),
          message(mosaic(bgr), "bayer_rggb16")};
}

TEST(ByteOrder, BigEndianImagesAreTheSamePicture) {
  for (const sensor_msgs::Image& image : encodingsOf(taken(12, 0.01))) {
    const cv::Mat wanted = bgrFromImage(image);
    EXPECT_EQ(cv::norm(bgrFromImage(bigEndian(image)), wanted, cv::NORM_INF), 0) << image.encoding;
  }
  sensor_msgs::Image cut = bigEndian(message(grey(taken(12, 0.01)), "mono16"));
  cut.data.resize(cut.data.size() - 1);
  EXPECT_THAT(refusal(cut), testing::HasSubstr("bytes of data are too few"));
}

TEST(ByteOrder, ImagesFlaggedOtherwiseThanTheyAreAreRefused) {
  for (const int bits : {10, 12, 14, 16})
    for (sensor_msgs::Image image : encodingsOf(taken(bits, 0.01)))
      for (const bool big : {false, true}) {
        if (big) image = bigEndian(image);
        EXPECT_EQ(refusal(image), "") << bits << image.encoding;
        image.is_bigendian = !big;
        EXPECT_EQ(refusal(image),
                  "image " + std::to_string(image.width) + "x" + std::to_string(image.height) + " of encoding '" +
                      image.encoding +
                      "': its 16-bit values are noise as they are, and a picture with their two bytes exchanged: the "
                      "bytes are in the other order than is_bigendian of the camera's image says; have its driver set "
                      "is_bigendian right")
            << bits;
        image.is_bigendian = big;
      }
  sensor_msgs::CompressedImage compressed;  // made of an image that was flagged wrongly
  compressed.format = "mono16; png compressed ";
  sensor_msgs::Image wrong = withBytesSwapped(message(grey(taken(12, 0.01)), "mono16"));
  cv::imencode(".png", cv_bridge::toCvCopy(wrong)->image, compressed.data);
  EXPECT_THAT(refusal(compressed),
              testing::HasSubstr("compressed image of format 'mono16; png compressed ': its 16-bit"));
}

TEST(ByteOrder, RightImagesAreFarFromRefusedHoweverNoisyOrDark) {
  double nearest_right = 0, nearest_wrong = 1e9;
  for (const int bits : {10, 12, 14, 16})
    for (const double gain : {1.0, 0.5, 0.3, 3.0})
      for (const double noise : {0.0, 0.002, 0.01, 0.05, 0.3}) {
        const cv::Mat bgr = taken(bits, noise, gain);
        for (const int shift : {0, 16 - bits})  // in the lower bits, and in the upper ones
          for (const auto& [pixels, encoding] :
               {std::pair<cv::Mat, std::string>(grey(bgr), "mono16"), {bgr, "bgr16"}, {mosaic(bgr), "bayer_rggb16"}}) {
            const Roughness r = roughnessOf(pixels * (1 << shift), encoding);
            nearest_right = std::max(nearest_right, r.as_is / r.swapped);
            EXPECT_LT(r.as_is, 1.05 * r.swapped) << bits << " bits, gain " << gain << ", noise " << noise << encoding;
            if (noise <= 0.01 && (gain == 1 || gain == 0.5) && shift == 0)
              nearest_wrong = std::min(nearest_wrong, r.swapped / r.as_is);
          }
      }
  RecordProperty("nearest_right", std::to_string(nearest_right));
  RecordProperty("nearest_wrong", std::to_string(nearest_wrong));
  EXPECT_GT(nearest_wrong, 1.5);
}

TEST(ByteOrder, WhatIsNoPictureOrOfOneByteIsLeftAlone) {
  cv::Mat noise(60, 80, CV_16U);
  cv::RNG(3).fill(noise, cv::RNG::UNIFORM, 0, 65536);
  for (const cv::Mat& image :
       {cv::Mat(60, 80, CV_16U, cv::Scalar(0x0102)), noise, cv::Mat(1, 1, CV_16U, cv::Scalar(7)),
        cv::Mat(grey(taken(8, 0.01))), cv::Mat(grey(taken(8, 0.01)) * 256), cv::Mat(grey(taken(8, 0.01)) * 257)})
    EXPECT_EQ(refusal(message(image, "mono16")), "");
}

}  // namespace
}  // namespace cortshift_stereo
