// What rectification makes of images whose every value is known, where highlights are, and how holes are filled.
#include "cortshift_stereo/rectification/rectifier.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "rectification/fill.hpp"
#include "rectification/highlights.hpp"

namespace cortshift_stereo {
namespace {

const cv::Size kSize(160, 100);

/// Ideal cameras; rectification moves the images by `shift` [px] and nothing else.
StereoModel shiftedBy(cv::Vec2d shift) {
  StereoModel model;
  for (CameraModel* camera : {&model.left, &model.right}) {
    camera->size = kSize;
    camera->K = cv::Matx33d(500, 0, 80, 0, 500, 50, 0, 0, 1);
    camera->P = cv::Matx34d(500, 0, 80 + shift[0], 0, 0, 500, 50 + shift[1], 0, 0, 0, 1, 0);
  }
  model.right.P(0, 3) = -500 * 0.02;
  return model;
}

TEST(Rectifier, LuminanceIsTheMeanOfTheChannels) {
  const cv::Mat image(kSize, CV_8UC3, cv::Scalar(30, 60, 150));
  const RectifiedPair pair = Rectifier(shiftedBy({0.3, -0.4})).rectify(image, image);
  EXPECT_NEAR(pair.left.at<float>(50, 80), 80, 0.02);
  EXPECT_NEAR(pair.right.at<float>(20, 30), 80, 0.02);
  EXPECT_EQ(pair.left_sharp.at<uint8_t>(50, 80), 80);
  EXPECT_EQ(pair.left_colour.at<cv::Vec3b>(50, 80), cv::Vec3b(30, 60, 150));
  EXPECT_FALSE(pair.has_highlights);
}

TEST(Rectifier, ReadsRampsBetweenPixelsWithoutAGrid) {
  cv::Mat image(kSize, CV_8UC3);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x)
      image.at<cv::Vec3b>(y, x) = cv::Vec3b(static_cast<uint8_t>(x), static_cast<uint8_t>(y), static_cast<uint8_t>(20));
  for (const cv::Vec2d& shift : {cv::Vec2d(0, 0), cv::Vec2d(0.25, 0.5), cv::Vec2d(-3.015, 2.73)}) {
    const RectifiedPair pair = Rectifier(shiftedBy(shift)).rectify(image, image);
    for (const cv::Point p : {cv::Point(40, 30), cv::Point(90, 60), cv::Point(121, 77)}) {
      const double x = p.x - shift[0], y = p.y - shift[1];
      EXPECT_NEAR(pair.left.at<float>(p), (x + y + 20) / 3, 0.03) << p << shift;
      EXPECT_NEAR(pair.right.at<float>(p), (x + y + 20) / 3, 0.03) << p << shift;
      EXPECT_NEAR(pair.left_colour.at<cv::Vec3b>(p)[0], x, 1) << p << shift;
      EXPECT_NEAR(pair.left_colour.at<cv::Vec3b>(p)[1], y, 1) << p << shift;
    }
  }
}

TEST(Rectifier, KnowsWhatTheRawImageShows) {
  const cv::Mat image(kSize, CV_8UC3, cv::Scalar::all(90));
  const Rectifier rectifier(shiftedBy({40, 0}));
  const RectifiedPair pair = rectifier.rectify(image, image);
  EXPECT_EQ(pair.left_seen.at<uint8_t>(50, 30), 0);
  EXPECT_EQ(pair.left_seen.at<uint8_t>(50, 50), 255);
  EXPECT_NEAR(rectifier.leftShare(), 120.0 / 160, 0.04);
  EXPECT_THROW(rectifier.rectify(image(cv::Rect(0, 0, 100, 100)), image), std::exception);
}

/// Coloured tissue with some spread, 1024 pixels wide: two raw pixels are one of the reduced image.
cv::Mat tissue() {
  cv::Mat image(600, 1024, CV_8UC3);
  cv::RNG random(3);
  for (auto it = image.begin<cv::Vec3b>(); it != image.end<cv::Vec3b>(); ++it) {
    const int grain = random.uniform(-3, 4);
    *it = cv::Vec3b(static_cast<uint8_t>(60 + grain), static_cast<uint8_t>(70 + grain),
                    static_cast<uint8_t>(150 + grain));
  }
  return image;
}

TEST(Highlights, AreSaturatedPixelsAndTheGlowNearThem) {
  cv::Mat image = tissue();
  const cv::Point lamp(700, 200);
  const auto around = [&](int distance) {
    return std::vector<cv::Point>{lamp + cv::Point(distance, 0), lamp - cv::Point(distance, 0),
                                  lamp + cv::Point(0, distance), lamp - cv::Point(0, distance)};
  };
  // Pale spots near the mirrored lamp and the same ones farther away.
  for (const int distance : {19, 60})
    for (const cv::Point& spot : around(distance)) cv::circle(image, spot, 4, cv::Scalar(150, 155, 190), -1);
  cv::circle(image, lamp, 4, cv::Scalar(255, 255, 255), -1);
  const Highlights found = findHighlights(image);
  EXPECT_EQ(found.saturated.at<uint8_t>(lamp), 255);
  EXPECT_EQ(found.saturated.at<uint8_t>(lamp + cv::Point(5, 0)), 255);  // and the pixels beside them
  EXPECT_EQ(found.saturated.at<uint8_t>(lamp + cv::Point(7, 0)), 0);
  for (const cv::Point& spot : around(19)) EXPECT_EQ(found.glow.at<uint8_t>(spot), 255) << spot;
  for (const cv::Point& spot : around(60)) EXPECT_EQ(found.glow.at<uint8_t>(spot), 0) << spot << ": no lamp is near";
  for (const cv::Point& dark : around(12))
    EXPECT_EQ(found.glow.at<uint8_t>(dark), 0) << dark << ": as dark as all tissue";
}

TEST(Highlights, OneSaturatedChannelIsBrightTissue) {
  cv::Mat image = tissue();
  cv::circle(image, {500, 300}, 20, cv::Scalar(60, 70, 255), -1);
  EXPECT_TRUE(findHighlights(image).saturated.empty());
  image.at<cv::Vec3b>(300, 500) = cv::Vec3b(60, 250, 250);
  EXPECT_EQ(cv::countNonZero(findHighlights(image).saturated), 9);
}

TEST(FillUnknown, KeepsWhatIsKnownAndContinuesARamp) {
  cv::Mat values(64, 96, CV_32FC1), known(64, 96, CV_8UC1, cv::Scalar(255));
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 96; ++x)
      values.at<float>(y, x) = 5 + 0.1f * static_cast<float>(x) - 0.05f * static_cast<float>(y);
  const cv::Mat truth = values.clone();
  cv::circle(known, {48, 32}, 9, cv::Scalar(0), -1);
  values.setTo(std::nanf(""), ~known);
  const cv::Mat filled = fillUnknown(values, known);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 96; ++x) {
      const double gap = std::abs(filled.at<float>(y, x) - truth.at<float>(y, x));
      EXPECT_LE(gap, known.at<uint8_t>(y, x) ? 0 : 0.5) << x << " " << y;
    }
}

}  // namespace
}  // namespace cortshift_stereo
