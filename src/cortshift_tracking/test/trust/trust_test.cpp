#include "cortshift_tracking/trust/trust.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "cortshift_tracking/matching/image_matching.hpp"
#include "trust/fitted_weights.hpp"

namespace cortshift_tracking {
namespace {

cv::Mat fullMask(int columns, int rows) { return cv::Mat(rows, columns, CV_8UC1, cv::Scalar(255)); }

cv::Mat confidenceBy(const VectorEvidence& evidence) { return confidenceOf(evidence, probabilityOfMatch(evidence)); }

/// A covered projection of random texture.
Projection textured(cv::Size size, std::uint64_t seed) {
  Projection projection;
  projection.resolution = 0.0001;
  projection.colour.create(size, CV_32FC3);
  cv::RNG random(seed);
  random.fill(projection.colour, cv::RNG::UNIFORM, 0.2, 0.8);
  cv::GaussianBlur(projection.colour, projection.colour, cv::Size(), 1.5);
  projection.mask = cv::Mat(size, CV_8UC1, cv::Scalar(255));
  projection.fold = cv::Mat::zeros(size, CV_8UC1);
  projection.confidence = cv::Mat(size, CV_32FC1, cv::Scalar(1));
  projection.height = cv::Mat::zeros(size, CV_32FC1);
  return projection;
}

TEST(ErodeBorder, TakesTheBorderFromTheOuterBoundary) {
  const cv::Mat eroded = erodeBorder(fullMask(100, 80), 20, 0);
  EXPECT_EQ(cv::countNonZero(eroded), 60 * 40);
  EXPECT_EQ(eroded.at<uchar>(20, 20), 255);
  EXPECT_EQ(eroded.at<uchar>(19, 20), 0);
}

TEST(ErodeBorder, LargeHolesGrowAndSmallOnesDoNot) {
  cv::Mat mask = fullMask(300, 200);
  cv::circle(mask, {80, 100}, 15, 0, cv::FILLED);  // 3 mm wide
  cv::circle(mask, {200, 100}, 7, 0, cv::FILLED);  // 1.4 mm wide
  cv::line(mask, {150, 40}, {150, 160}, 0, 3);     // long but narrow
  const cv::Mat eroded = erodeBorder(mask, 20, 20);
  EXPECT_EQ(eroded.at<uchar>(100, 80 + 30), 0);
  EXPECT_EQ(eroded.at<uchar>(100, 80 + 37), 255);
  EXPECT_EQ(eroded.at<uchar>(100, 200), 0);  // still a hole
  EXPECT_EQ(eroded.at<uchar>(100, 200 + 9), 255);
  EXPECT_EQ(eroded.at<uchar>(100, 150), 0);
  EXPECT_EQ(eroded.at<uchar>(100, 154), 255);
}

TEST(ErodeBorder, HolesWithinKeepTheirSizeUnlessAsked) {
  cv::Mat mask = fullMask(300, 200);
  cv::circle(mask, {80, 100}, 15, 0, cv::FILLED);
  const cv::Mat eroded = erodeBorder(mask, 20, 0);
  EXPECT_EQ(eroded.at<uchar>(100, 80), 0);
  EXPECT_EQ(eroded.at<uchar>(100, 80 + 17), 255);
  EXPECT_EQ(eroded.at<uchar>(100, 19), 0);
}

TEST(ErodeBorder, ABayOpenToTheOutsideGrows) {
  cv::Mat mask = fullMask(200, 200);
  cv::rectangle(mask, cv::Rect(95, 0, 10, 100), 0, cv::FILLED);
  EXPECT_EQ(erodeBorder(mask, 20, 0).at<uchar>(60, 115), 0);
}

TEST(UsableMask, DropsGlareWithItsMarginAndFolds) {
  Projection projection = textured({100, 100}, 1);
  projection.colour.at<cv::Vec3f>(50, 50) = cv::Vec3f(1, 1, 1);
  projection.colour.at<cv::Vec3f>(20, 20) = cv::Vec3f(0.3F, 0.3F, 1);  // bright red tissue is no highlight
  projection.fold.at<uchar>(80, 80) = 255;
  const cv::Mat usable = usableMask(projection);
  EXPECT_EQ(usable.at<uchar>(50, 54), 0);
  EXPECT_EQ(usable.at<uchar>(50, 56), 255);
  EXPECT_EQ(usable.at<uchar>(20, 20), 255);
  EXPECT_EQ(usable.at<uchar>(80, 80), 0);
}

TEST(Agreement, FollowsTheCorrelationAndIgnoresLight) {
  const Projection earlier = textured({160, 80}, 1);
  cv::Mat later = earlier.colour.clone();
  textured({80, 80}, 2).colour.copyTo(later(cv::Rect(80, 0, 80, 80)));  // right half: something else
  for (int row = 0; row < later.rows; ++row)
    for (int column = 0; column < later.cols; ++column)
      later.at<cv::Vec3f>(row, column) *= 0.5F + 0.005F * static_cast<float>(row);  // a shadow across
  cv::Mat bare_earlier = earlier.colour(cv::Rect(0, 0, 40, 80));                    // left quarter: no texture
  bare_earlier.setTo(cv::Scalar::all(0.5));
  const cv::Mat flow = cv::Mat::zeros(80, 160, CV_32FC2), all = fullMask(160, 80);
  const auto seen = [&](const cv::Mat& colour) -> Seen {
    return {flowImage(colour, all, "luminance", 3.5), colour, all};
  };
  const Agreement agreement = agreementOf(seen(earlier.colour), seen(later), flow, earlier.resolution);
  EXPECT_LT(std::abs(agreement.correlation.at<float>(40, 15)), 0.3F);
  EXPECT_GT(agreement.correlation.at<float>(40, 60), 0.65F);  // the fine part of this texture is near the noise
  EXPECT_LT(std::abs(agreement.correlation.at<float>(40, 120)), 0.4F);
  EXPECT_LT(agreement.residual.at<float>(40, 60), 0.3F * agreement.residual.at<float>(40, 120));
}

TEST(Agreement, TheApertureIsWhatTheTextureLeavesOpen) {
  // Stripes of 0.1 on 0.5 that change along the columns alone, then along both, then not at all: side by side.
  constexpr double kPeriod = 12;                       // [px]
  cv::Mat first(60, 240, CV_32FC1, cv::Scalar(0.5F));  // 0.1 mm
  for (int row = 0; row < first.rows; ++row)
    for (int column = 0; column < 160; ++column) {
      const double across = std::sin(2 * M_PI * column / kPeriod), along = std::sin(2 * M_PI * row / kPeriod);
      first.at<float>(row, column) += static_cast<float>(0.1 * (column < 80 ? across : 0.5 * (across + along)));
    }
  cv::Mat noisy[2] = {first.clone(), first.clone()};
  cv::RNG random(1);
  for (cv::Mat& image : noisy) {
    cv::Mat noise(image.size(), CV_32FC1);
    random.fill(noise, cv::RNG::NORMAL, 0, 0.005);
    image += noise;
  }
  const cv::Mat flow = cv::Mat::zeros(60, 240, CV_32FC2), all = fullMask(240, 60);
  cv::Mat colour;
  cv::cvtColor(first, colour, cv::COLOR_GRAY2BGR);
  AgreementSettings settings;
  settings.image_noise = 0.02;
  const auto apertureOf = [&](const cv::Mat& a, const cv::Mat& b, const cv::Mat& usable) {
    return agreementOf({a, colour, usable}, {b, colour, usable}, flow, 0.0001, settings).aperture;
  };
  const cv::Mat aperture = apertureOf(first, first, all), of_noisy = apertureOf(noisy[0], noisy[1], all);
  // Noise over the root of the sum of squared slopes of one of the two waves over 21 x 21 pixels.
  const double slope = 0.05 * std::sin(2 * M_PI / kPeriod) / std::sqrt(2.0),
               both = std::sqrt(2.0) * 0.0001 * 0.02 / (21 * slope);
  EXPECT_NEAR(aperture.at<float>(30, 120), both, 0.1 * both);
  EXPECT_NEAR(of_noisy.at<float>(30, 120), both, 0.15 * both);  // noise is no texture
  EXPECT_GT(aperture.at<float>(30, 40), 20 * both);             // nothing holds it along the stripes
  EXPECT_GT(of_noisy.at<float>(30, 40), 3 * both);
  EXPECT_GT(of_noisy.at<float>(30, 220), 3 * both);
  cv::Mat half = all.clone();
  half.rowRange(0, 30).setTo(0);  // at the edge half as much is compared
  EXPECT_NEAR(apertureOf(first, first, half).at<float>(30, 120), std::sqrt(2.0) * both, 0.15 * both);
}

TEST(Agreement, AnInstrumentOfAnotherHueIsSeenAndTheLampsColourIsNot) {
  const Projection earlier = textured({200, 100}, 1);
  cv::Mat later;
  cv::multiply(earlier.colour, cv::Scalar(0.8, 1.0, 1.1), later);  // a warmer lamp
  cv::Mat metal = later(cv::Rect(150, 0, 50, 100));                // the same pattern, but greener
  cv::multiply(metal, cv::Scalar(1.0, 1.6, 1.0), metal);
  const cv::Mat flow = cv::Mat::zeros(100, 200, CV_32FC2), all = fullMask(200, 100);
  const auto seen = [&](const cv::Mat& colour) -> Seen {
    return {flowImage(colour, all, "luminance", 3.5), colour, all};
  };
  const Agreement agreement = agreementOf(seen(earlier.colour), seen(later), flow, earlier.resolution);
  EXPECT_LT(agreement.hue.at<float>(50, 60), 0.02F);
  EXPECT_GT(agreement.hue.at<float>(50, 175), 0.5F);
}

/// A flow that is sure of itself.
ProjectionMatch matchOf(const cv::Mat& flow, const std::string& channels = "rgb") {
  ProjectionMatch match;
  match.flow = flow;
  match.confidence = cv::Mat(flow.size(), CV_32FC1, cv::Scalar(0.99));
  match.channels = channels;
  return match;
}

TEST(Confidence, AFewVectorsAmidWrongOnesAreNotBelieved) {
  const cv::Mat exact = cv::Mat::zeros(300, 300, CV_32FC1);
  const Projection earlier = textured({300, 300}, 1), other = textured({300, 300}, 2);
  cv::Mat restless(300, 300, CV_32FC2);  // as a flow is where nothing matches
  cv::theRNG().state = 1;
  cv::randn(restless, 0, 1);
  const auto agreeingIn = [&](int side) {  // the later stage shows something else but for a square in the middle
    Projection later = other;
    later.colour = other.colour.clone();
    const cv::Rect patch(150 - side / 2, 150 - side / 2, side, side);
    earlier.colour(patch).copyTo(later.colour(patch));
    cv::Mat flow = restless.clone();
    flow(patch).setTo(0);
    const cv::Mat all = fullMask(300, 300);
    return confidenceBy(evidenceOf(earlier, later, matchOf(flow), exact, all, all)).at<float>(150, 150);
  };
  EXPECT_EQ(agreeingIn(24), 0);
  EXPECT_GT(agreeingIn(120), 0.8F);
}

TEST(Confidence, UnsureSurfacesAndTheBorderOfBothStagesLowerIt) {
  cv::Mat errors = cv::Mat::zeros(200, 200, CV_32FC1);
  errors.at<float>(100, 110) = 0.0003F;
  Projection earlier = textured({200, 200}, 1), later = earlier;
  later.colour = earlier.colour.clone();
  const cv::Mat all = fullMask(200, 200);
  cv::Mat flow = cv::Mat::zeros(200, 200, CV_32FC2);
  cv::Mat confidence = confidenceBy(evidenceOf(earlier, later, matchOf(flow), errors, all, all));
  EXPECT_GT(confidence.at<float>(100, 100), 0.9F);
  const float share = std::erf(0.25F / (0.3F * kExpectedTooLittle * std::sqrt(2.0F)));
  EXPECT_NEAR(confidence.at<float>(100, 110), share * confidence.at<float>(100, 100), 0.001F);
  EXPECT_EQ(confidence.at<float>(10, 100), 0);      // 1 mm from the border
  flow.at<cv::Vec2f>(100, 100) = cv::Vec2f(85, 0);  // ends 1.5 mm from the border
  confidence = confidenceBy(evidenceOf(earlier, later, matchOf(flow), errors, all, all));
  EXPECT_EQ(confidence.at<float>(100, 100), 0);
}

TEST(Confidence, IsThatOfTheChannelsThatTheFlowSaw) {
  const cv::Mat exact = cv::Mat::zeros(200, 200, CV_32FC1), still = cv::Mat::zeros(200, 200, CV_32FC2);
  const Projection earlier = textured({200, 200}, 1), other = textured({200, 200}, 2);
  Projection later = earlier;  // blue shows the same tissue, green and red something else
  later.colour = other.colour.clone();
  const int blue[] = {0, 0};
  cv::mixChannels(&earlier.colour, 1, &later.colour, 1, blue, 1);
  const cv::Mat all = fullMask(200, 200);
  const auto odds = [&](const char* channels) {
    const cv::Mat confidence = confidenceBy(evidenceOf(earlier, later, matchOf(still, channels), exact, all, all));
    const double mean = cv::mean(confidence(cv::Rect(50, 50, 100, 100)))[0];
    return mean / (1 - mean);
  };
  EXPECT_GT(odds("blue"), 10 * odds("rgb"));
  EXPECT_GT(odds("blue"), 10 * odds("green"));
}

TEST(Overlap, IsAPartOfTheEarlierArea) {
  Projection earlier = textured({100, 100}, 1), later = textured({100, 100}, 1);
  earlier.mask.colRange(0, 20).setTo(0);
  later.mask.colRange(60, 100).setTo(0);
  EXPECT_DOUBLE_EQ(overlapOf(earlier, later), 0.5);
}

TEST(FillHoles, KeepsWhatIsThereAndContinuesItSmoothly) {
  cv::Mat image(60, 80, CV_32FC3), mask = fullMask(80, 60);
  for (int row = 0; row < 60; ++row)
    for (int column = 0; column < 80; ++column)
      image.at<cv::Vec3f>(row, column) = cv::Vec3f(0.01F * static_cast<float>(column), 0.3F, 0.6F);
  cv::Mat holed = image.clone();
  holed(cv::Rect(30, 20, 10, 10)).setTo(cv::Scalar::all(0));
  mask(cv::Rect(30, 20, 10, 10)).setTo(0);
  const cv::Mat filled = fillHoles(holed, mask);
  EXPECT_LT(cv::norm(filled - image, cv::NORM_INF), 0.06);
  cv::Mat difference = cv::abs(filled - image);
  difference.setTo(cv::Scalar::all(0), mask == 0);
  EXPECT_EQ(cv::norm(difference, cv::NORM_INF), 0);
}

}  // namespace
}  // namespace cortshift_tracking
