#include "cortshift_tracking/trust/trust.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <vector>

#include "cortshift_tracking/matching/image_matching.hpp"

namespace cortshift_tracking {
namespace {

cv::Mat fullMask(int columns, int rows) { return cv::Mat(rows, columns, CV_8UC1, cv::Scalar(255)); }

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

double odds(double probability) { return probability / (1 - probability); }

/// What a doubt does to the odds of a vector: from each of the values to the next they fall, and at last are at most
/// this share of the first ones.
template <typename Evidence, typename Probability>
void expectOddsToFall(const char* doubt, Evidence evidence, float Evidence::*value, const std::vector<float>& values,
                      double share, const Probability& probability) {
  std::vector<double> found;
  for (const float one : values) {
    evidence.*value = one;
    found.push_back(odds(probability(evidence)));
  }
  EXPECT_EQ(std::adjacent_find(found.begin(), found.end(), [](double a, double b) { return !(b < a); }), found.end())
      << doubt << " does not lower the odds at every step: " << testing::PrintToString(found);
  EXPECT_LT(found.back(), share * found.front()) << doubt;
}

TEST(ProbabilityOfMatch, FallsWithEveryDoubt) {
  const MatchEvidence sound{5e-6F, 0.95F, 0.005F, 0.02F, 5e-6F};
  EXPECT_GT(probabilityOfMatch(sound), 0.99);
  const auto probability = [](const MatchEvidence& evidence) { return probabilityOfMatch(evidence); };
  // From what a good match shows to what a wrong one does.
  expectOddsToFall("flow_error", sound, &MatchEvidence::flow_error, {5e-6F, 2e-5F, 8e-5F, 3e-4F, 1e-3F}, 0.1,
                   probability);
  expectOddsToFall("correlation", sound, &MatchEvidence::correlation, {0.95F, 0.7F, 0.4F, 0.0F, -0.5F}, 0.02,
                   probability);
  expectOddsToFall("residual", sound, &MatchEvidence::residual, {0.005F, 0.01F, 0.03F, 0.08F, 0.2F}, 0.1, probability);
  expectOddsToFall("hue", sound, &MatchEvidence::hue, {0.02F, 0.05F, 0.15F, 0.4F, 1.0F}, 0.25, probability);
  expectOddsToFall("bend", sound, &MatchEvidence::bend, {5e-6F, 2e-5F, 6e-5F, 2e-4F, 5e-4F}, 0.02, probability);
  MatchEvidence none = sound;
  none.flow_error = std::numeric_limits<float>::infinity();
  EXPECT_EQ(probabilityOfMatch(none), 0);
  // Two or three middling doubts together are enough for the gate of 0.5; one is not.
  EXPECT_GT(probabilityOfMatch({1e-4F, 0.9F, 0.01F, 0.03F, 1e-5F}), 0.9);
  EXPECT_LT(probabilityOfMatch({1e-4F, 0.3F, 0.05F, 0.1F, 5e-5F}), 0.5);
  EXPECT_LT(probabilityOfMatch({1e-4F, 0.0F, 0.08F, 0.2F, 3e-5F}), 0.15);
}

TEST(ProbabilityOfHeight, FallsWithEveryDoubt) {
  const HeightEvidence sound{1e-5F, 2e-5F};
  EXPECT_GT(probabilityOfHeight(sound), 0.99);
  const auto probability = [](const HeightEvidence& evidence) { return probabilityOfHeight(evidence); };
  expectOddsToFall("roughness", sound, &HeightEvidence::roughness, {1e-5F, 3e-5F, 1e-4F, 3e-4F, 1e-3F}, 0.01,
                   probability);
  expectOddsToFall("deviation", sound, &HeightEvidence::deviation, {8e-5F, 1.2e-4F, 2.5e-4F, 5e-4F, 1e-3F}, 0.01,
                   probability);
  EXPECT_GT(probabilityOfHeight({1e-4F, 5e-5F}), 0.9);
  EXPECT_LT(probabilityOfHeight({5e-4F, 2.5e-4F}), 0.5);
  EXPECT_LT(probabilityOfHeight({1e-3F, 4e-4F}), 0.25);
}

double logOdds(float probability) {
  return std::log(static_cast<double>(probability) / (1 - static_cast<double>(probability)));
}

// What a fit wrote is not rounded, doubled or taken for another's by chance: the odds at one place, and how they change
// from there.
TEST(Probabilities, AreThoseThatWereFitted) {
  constexpr auto kE = static_cast<float>(M_E);
  const MatchEvidence match{1e-4F, 0.5F, 0.05F, 0.1F, 5e-5F};
  const double matched = logOdds(probabilityOfMatch(match));
  EXPECT_NEAR(matched, -0.2283, 1e-3);
  const auto changed = [&](float MatchEvidence::*doubt, float value) {
    MatchEvidence other = match;
    other.*doubt = value;
    return logOdds(probabilityOfMatch(other)) - matched;
  };
  EXPECT_NEAR(changed(&MatchEvidence::flow_error, kE * 1e-4F), -0.6251, 1e-4);
  EXPECT_NEAR(changed(&MatchEvidence::correlation, 0.6F), 0.4531, 1e-4);
  EXPECT_NEAR(changed(&MatchEvidence::residual, kE * 0.05F), -0.7433, 1e-4);
  EXPECT_NEAR(changed(&MatchEvidence::hue, kE * 0.1F), -0.4316, 1e-4);
  EXPECT_NEAR(changed(&MatchEvidence::bend, kE * 5e-5F), -1.054, 1e-4);

  EXPECT_NEAR(logOdds(probabilityOfHeight({3e-4F, 0})), 1.818, 1e-3);
  EXPECT_NEAR(logOdds(probabilityOfHeight({kE * 3e-4F, 0})), 1.818 - 1.505, 1e-3);
  // 0.25 mm are 2 and 0.5 of the standard deviations that are found, 1.2 times the expected ones.
  EXPECT_NEAR(probabilityOfHeight({1e-5F, 0.000125F / 1.2F}), 0.9545 * probabilityOfHeight({1e-5F, 0}), 1e-4);
  EXPECT_NEAR(probabilityOfHeight({1e-5F, 0.0005F / 1.2F}), 0.3829 * probabilityOfHeight({1e-5F, 0}), 1e-4);

  // Beyond what the fit has seen nothing changes.
  const std::tuple<float MatchEvidence::*, float, float> ends[] = {{&MatchEvidence::flow_error, 3e-6F, 1e-3F},
                                                                   {&MatchEvidence::residual, 0.002F, 0.2F},
                                                                   {&MatchEvidence::hue, 0.01F, 1.0F},
                                                                   {&MatchEvidence::bend, 5e-6F, 5e-4F}};
  for (const auto& [doubt, low, high] : ends) {
    EXPECT_EQ(changed(doubt, low), changed(doubt, 0.1F * low));
    EXPECT_LT(changed(doubt, 1.1F * low), changed(doubt, low));
    EXPECT_EQ(changed(doubt, high), changed(doubt, 10 * high));
    EXPECT_GT(changed(doubt, 0.9F * high), changed(doubt, high));
  }
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

TEST(CombineConfidence, AFewVectorsAmidWrongOnesAreNotBelieved) {
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
    const cv::Mat all = fullMask(300, 300), flow_confidence(300, 300, CV_32FC1, cv::Scalar(0.99));
    return combineConfidence(earlier, later, flow, flow_confidence, exact, all, all).at<float>(150, 150);
  };
  EXPECT_EQ(agreeingIn(24), 0);
  EXPECT_GT(agreeingIn(120), 0.8F);
}

TEST(CombineConfidence, UnsureSurfacesAndTheBorderOfBothStagesLowerIt) {
  cv::Mat errors = cv::Mat::zeros(200, 200, CV_32FC1);
  errors.at<float>(100, 110) = 0.0003F;
  Projection earlier = textured({200, 200}, 1), later = earlier;
  later.colour = earlier.colour.clone();
  const cv::Mat all = fullMask(200, 200), flow_confidence(200, 200, CV_32FC1, cv::Scalar(0.99));
  cv::Mat flow = cv::Mat::zeros(200, 200, CV_32FC2);
  cv::Mat confidence = combineConfidence(earlier, later, flow, flow_confidence, errors, all, all);
  EXPECT_GT(confidence.at<float>(100, 100), 0.9F);
  EXPECT_NEAR(confidence.at<float>(100, 110), 0.512F * confidence.at<float>(100, 100), 0.01F);
  EXPECT_EQ(confidence.at<float>(10, 100), 0);      // 1 mm from the border
  flow.at<cv::Vec2f>(100, 100) = cv::Vec2f(85, 0);  // ends 1.5 mm from the border
  confidence = combineConfidence(earlier, later, flow, flow_confidence, errors, all, all);
  EXPECT_EQ(confidence.at<float>(100, 100), 0);
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
