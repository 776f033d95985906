// What one image looks like, against images of which it is known.
#include "cortshift_stereo/admission/pair_quality.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cortshift_stereo {
namespace {

using testing::HasSubstr;

/// Detail of every size from `finest` [px] up, of 40 grey levels in all.
cv::Mat tissue(const cv::Size& size, double finest, uint64_t seed = 7) {
  cv::Mat sum = cv::Mat::zeros(size, CV_32F);
  cv::RNG chance(seed);
  for (double scale = finest; scale < 40; scale *= 1.6) {
    cv::Mat layer(size, CV_32F);
    chance.fill(layer, cv::RNG::NORMAL, 0, 1);
    cv::GaussianBlur(layer, layer, {}, scale);
    sum += layer * scale;  // as much of each size
  }
  cv::Mat image;
  cv::normalize(sum, sum, 88, 168, cv::NORM_MINMAX);
  sum.convertTo(image, CV_8U);
  cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
  return image;
}

cv::Mat withNoise(const cv::Mat& image, double sd) {
  cv::Mat noise(image.size(), CV_32FC3), noisy;
  cv::RNG(3).fill(noise, cv::RNG::NORMAL, 0, sd);
  cv::add(image, noise, noisy, {}, CV_8U);
  return noisy;
}

TEST(ImageQuality, ContrastAndSaturationAreCounted) {
  cv::Mat image(64, 80, CV_8UC3, cv::Scalar(100, 120, 140));
  EXPECT_EQ(measureImage(image).contrast, 0);
  EXPECT_EQ(measureImage(image).saturated_share, 0);
  image.colRange(0, 20).setTo(cv::Scalar(120, 140, 160));  // a quarter, 20 levels brighter
  EXPECT_NEAR(measureImage(image).contrast, 20 * std::sqrt(0.25 * 0.75), 1e-9);
  image.colRange(0, 20).setTo(cv::Scalar(250, 250, 20));   // two channels are enough
  image.colRange(20, 40).setTo(cv::Scalar(249, 255, 20));  // one is not
  EXPECT_EQ(measureImage(image).saturated_share, 0.25);
}

TEST(ImageQuality, FocusIsThatOfTheMiddleOfLargeImages) {
  const cv::Size size(640, 700);
  cv::Mat image, sharp = tissue(size, 1);
  cv::GaussianBlur(sharp, image, {}, 5);
  const ImageQuality blurred = measureImage(image);
  const cv::Rect middle((640 - 512) / 2, (700 - 512) / 2, 512, 512);
  sharp(middle).copyTo(image(middle));
  const ImageQuality quality = measureImage(image), of_middle = measureImage(sharp(middle));
  EXPECT_EQ(quality.sharpness, of_middle.sharpness);
  EXPECT_EQ(quality.detail, of_middle.detail);
  EXPECT_LT(blurred.sharpness, PairLimits().min_sharpness);
  EXPECT_GT(quality.sharpness, 0.5);
  for (const cv::Size& small : {cv::Size(640, 300), cv::Size(300, 640), cv::Size(200, 150)})
    EXPECT_GT(measureImage(tissue(small, 1)).sharpness, 0.5) << small;
}

TEST(ImageQuality, NoiseIsNoDetail) {
  for (double finest : {1.0, 2.0, 4.0}) {
    const cv::Mat image = tissue({400, 300}, finest);
    const double clean = measureImage(image).detail;
    for (double sd : {2.0, 4.0, 8.0})
      EXPECT_NEAR(measureImage(withNoise(image, sd)).detail, clean, 0.01) << "finest " << finest << ", noise " << sd;
  }
}

TEST(Rows, TwentyPointsAreEnoughAndNineteenAreNot) {
  RowAgreement rows;
  rows.matched = 20;
  EXPECT_EQ(judgeRows(rows, {}).findings.refusal(), nullptr);
  rows.matched = 19;
  const Findings found = judgeRows(rows, {}).findings;
  ASSERT_NE(found.refusal(), nullptr);
  EXPECT_EQ(found.refusal()->check, CheckId::kNoMatch);
  EXPECT_THAT(found.refusal()->sentence(), HasSubstr("only 19 points"));
}

}  // namespace
}  // namespace cortshift_stereo
