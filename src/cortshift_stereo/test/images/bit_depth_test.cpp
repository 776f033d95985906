#include "cortshift_stereo/images/bit_depth.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace cortshift_stereo {
namespace {

/// A picture of 8 bits with its brightest spot at `top`, some noise, three channels.
cv::Mat picture(int top = 255) {
  cv::Mat image(48, 64, CV_8UC3);
  cv::RNG random(3);
  random.fill(image, cv::RNG::UNIFORM, 0, top);
  image.at<cv::Vec3b>(7, 9) = cv::Vec3b(static_cast<uchar>(top), 0, 0);
  return image;
}

/// The picture as a camera of so many bits gives it, in the lower bits of 16.
cv::Mat with(int bits, const cv::Mat& image) {
  cv::Mat out;
  image.convertTo(out, CV_16U, ((1 << bits) - 1) / 255.0);
  return out;
}

std::string refusal(BitDepth depth, cv::Mat left, cv::Mat right) {
  try {
    depth.toEightBits(left, right);
  } catch (const ImageError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(BitDepth, TenTwelveFourteenAndSixteenBitsGiveOnePicture) {
  for (const int bits : {10, 12, 14, 16}) {
    BitDepth depth;
    cv::Mat left = with(bits, picture()), right = with(bits, picture(180));
    depth.toEightBits(left, right);
    EXPECT_EQ(depth.bits(), bits);
    EXPECT_EQ(left.type(), CV_8UC3);
    EXPECT_LE(cv::norm(left, picture(), cv::NORM_INF), 1) << bits;
    EXPECT_LE(cv::norm(right, picture(180), cv::NORM_INF), 1) << bits;
  }
}

TEST(BitDepth, ImagesOfEightBitsStayAsTheyAre) {
  BitDepth depth;
  cv::Mat left = picture(), right = picture(90);
  depth.toEightBits(left, right);
  EXPECT_EQ(cv::norm(left, picture(), cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(right, picture(90), cv::NORM_INF), 0);
  EXPECT_EQ(depth.bits(), 0);
}

TEST(BitDepth, ValuesInTheUpperBitsAreOfSixteen) {
  cv::Mat high = with(12, picture()) * 16;
  for (const int declared : {0, 12}) {
    BitDepth depth(declared);
    cv::Mat image = high.clone();
    depth.toEightBits(image);
    EXPECT_EQ(depth.bits(), 16);
    EXPECT_LE(cv::norm(image, picture(), cv::NORM_INF), 1);
  }
}

TEST(BitDepth, OneScaleServesBothCamerasAndTheWholeCase) {
  BitDepth depth;
  cv::Mat left = with(12, picture()), right = with(12, picture(40));  // right alone would pass for 10 bits
  depth.toEightBits(left, right);
  EXPECT_LE(cv::norm(right, picture(40), cv::NORM_INF), 1);
  cv::Mat dark_left = with(12, picture(50)), dark_right = with(12, picture(50));
  depth.toEightBits(dark_left, dark_right);
  EXPECT_LE(cv::norm(dark_left, picture(50), cv::NORM_INF), 1) << "a dark frame between others stays dark";
  EXPECT_EQ(depth.bits(), 12);
}

TEST(BitDepth, ADarkBeginningIsNotCutOffAndGivesWayOnce) {
  BitDepth depth;
  cv::Mat dark = with(12, picture(50)), light = with(12, picture());
  depth.toEightBits(dark);  // 12 bits, of which 10 are used: brighter by 4, and nothing is lost
  EXPECT_EQ(depth.bits(), 10);
  EXPECT_LE(cv::norm(dark, picture(50) * (4095.0 / 1023), cv::NORM_INF), 2);
  depth.toEightBits(light);
  EXPECT_EQ(depth.bits(), 12);
  EXPECT_LE(cv::norm(light, picture(), cv::NORM_INF), 1);
}

/// A picture of so many bits in which a few values say nothing of the light, of 307 200 pixels of one channel.
cv::Mat withStrayPixels(int bits, int count, int value) {
  cv::Mat image(480, 640, CV_8U);
  cv::RNG(5).fill(image, cv::RNG::UNIFORM, 0, 256);
  image = with(bits, image);
  for (int i = 0; i < count; ++i) image.at<uint16_t>(0, i) = static_cast<uint16_t>(value);
  return image;
}

TEST(BitDepth, HotPixelsAndACounterInTheFirstPixelsTellNothing) {
  for (const int bits : {10, 12, 14})
    for (const int declared : {0, bits})
      for (const auto& [count, value] : {std::pair(1, 65535), std::pair(30, 65535), std::pair(30, 0xFFF0)}) {
        SCOPED_TRACE(std::to_string(bits) + " bits, " + std::to_string(count) + " pixels of " + std::to_string(value));
        BitDepth depth(declared);
        cv::Mat left = withStrayPixels(bits, count, value), right = withStrayPixels(bits, 0, 0);
        const cv::Mat clean = right.clone();
        for (int pair = 0; pair < 2; ++pair) {  // in the left camera alone, then in both and in the next pair
          depth.toEightBits(left, right);
          EXPECT_EQ(depth.bits(), bits);
          EXPECT_EQ(left.at<uchar>(0, 0), 255);
          cv::Mat wanted;
          clean.convertTo(wanted, CV_8U, 255.0 / ((1 << bits) - 1));
          EXPECT_EQ(cv::norm(left.rowRange(1, 480), wanted.rowRange(1, 480), cv::NORM_INF), 0);
          EXPECT_EQ(cv::norm(right.rowRange(1, 480), wanted.rowRange(1, 480), cv::NORM_INF), 0);
          left = withStrayPixels(bits, count, value);
          right = left.clone();
        }
      }
}

TEST(BitDepth, WhatIsMoreThanStrayCounts) {
  BitDepth depth;
  cv::Mat image = withStrayPixels(12, 31, 65535);  // 0.0101 % of the pixels
  depth.toEightBits(image);
  EXPECT_EQ(depth.bits(), 16);
  EXPECT_NE(refusal(BitDepth(12), withStrayPixels(12, 31, 65535), withStrayPixels(12, 0, 0))
                .find("image_bits is 12, but the largest value of the 16-bit images is 65535;"),
            std::string::npos);
}

TEST(BitDepth, StrayPixelsDoNotMakeADarkImageLight) {
  EXPECT_NE(refusal(BitDepth(), withStrayPixels(8, 3, 65535), withStrayPixels(8, 0, 0))
                .find("at most 8 bits in 16-bit images (largest value 255, but for a few stray ones up to 65535)"),
            std::string::npos);
}

TEST(BitDepth, WhatCannotBeToldOrContradictsIsRefusedByName) {
  EXPECT_NE(refusal(BitDepth(), with(16, picture(1)) / 2, with(16, picture(1)) / 2)
                .find("at most 8 bits in 16-bit images (largest value 128)"),
            std::string::npos);
  EXPECT_EQ(refusal(BitDepth(), with(16, picture()), with(12, picture()))
                .find("unlike images: the left one uses 16 bits (largest value 65535) of 16, the right one 12 bits "
                      "(largest value "
                      "4095)"),
            0U);
  EXPECT_NE(refusal(BitDepth(10), with(12, picture()), with(12, picture()))
                .find("image_bits is 10, but the largest value of the 16-bit images is 4095"),
            std::string::npos);
  EXPECT_EQ(refusal(BitDepth(8), with(8, picture()), with(8, picture())), "accepted");
  EXPECT_EQ(refusal(BitDepth(16), with(16, picture(1)), with(12, picture())), "accepted");
  EXPECT_THROW(BitDepth(7), ImageError);
  EXPECT_THROW(BitDepth(17), ImageError);
}

}  // namespace
}  // namespace cortshift_stereo
