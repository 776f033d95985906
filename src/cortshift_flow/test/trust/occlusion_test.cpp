// What is hidden, and how the flow goes on behind it, on motions that are known.
#include "trust/occlusion.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "textures.hpp"
#include "trust/mismatch.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(120, 90);

TEST(ContinueFlow, GoesOnLinearlyIntoAHole) {
  const auto affine = [](float x, float y) { return cv::Vec2f(1 + 0.02f * x - 0.01f * y, -2 + 0.015f * y); };
  FlowPlanes flow = flowOf(kSize, affine);
  cv::Mat1b visible(kSize, uchar{1});
  cv::circle(visible, {60, 45}, 14, cv::Scalar(0), -1);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x)
      if (!visible(y, x)) flow.u.row(y)[x] = flow.v.row(y)[x] = 50;
  continueFlow(cv::Mat4f(kSize, cv::Vec4f::all(0.5f)), visible, Continue::kByColour, flow, 1);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      const cv::Vec2f w = affine(static_cast<float>(x), static_cast<float>(y));
      EXPECT_NEAR(flow.u.row(y)[x], w[0], 0.15) << x << " " << y;
      EXPECT_NEAR(flow.v.row(y)[x], w[1], 0.15) << x << " " << y;
    }
}

/// A strip that is hidden between tissue that moves (left) and a drape that rests (right).
FlowPlanes acrossAStrip(float strip_colour, Continue side) {
  cv::Mat4f image(kSize, cv::Vec4f(0.2f, 0.2f, 0.6f, 0));
  image.colRange(64, kSize.width).setTo(cv::Scalar(0.6, 0.2, 0.2, 0));
  cv::Mat1b visible(kSize, uchar{1});
  visible.colRange(56, 64).setTo(0);
  image.colRange(56, 64).setTo(strip_colour > 0 ? cv::Scalar(0.2, 0.2, 0.6, 0) : cv::Scalar(0.6, 0.2, 0.2, 0));
  FlowPlanes flow = flowOf(kSize, [](float x, float) { return x < 56 ? cv::Vec2f(6, 1) : cv::Vec2f(0, 0); });
  continueFlow(image, visible, side, flow, 1);
  return flow;
}

TEST(ContinueFlow, TheSideOfTheSameColourHasTheStrip) {
  const FlowPlanes tissue = acrossAStrip(1, Continue::kByColour), drape = acrossAStrip(-1, Continue::kByColour);
  for (int x = 57; x < 63; ++x) {
    EXPECT_NEAR(tissue.u.row(45)[x], 6, 0.3) << x;
    EXPECT_NEAR(tissue.v.row(45)[x], 1, 0.3) << x;
    EXPECT_NEAR(drape.u.row(45)[x], 0, 0.3) << x;
  }
}

TEST(ContinueFlow, WhatLiesBehindHasItWhereThatIsAsked) {
  const FlowPlanes flow = acrossAStrip(1, Continue::kResting);
  for (int x = 57; x < 63; ++x) EXPECT_NEAR(flow.u.row(45)[x], 0, 0.3) << x;
}

TEST(CoveredBy, IsWhereSomethingFlowsBackTo) {
  // Backward flow of a second image that shows the first from column 20 on: its first columns stay behind.
  const cv::Mat1b covered = coveredBy(constantFlow(kSize, 20, 0), {});
  EXPECT_EQ(covered(45, 10), 0);
  EXPECT_EQ(covered(45, 17), 0);
  EXPECT_EQ(covered(45, 22), 1);
  EXPECT_EQ(covered(45, 100), 1);
  cv::Mat1b trusted(kSize, uchar{1});
  trusted.rowRange(0, 30).setTo(0);
  EXPECT_EQ(coveredBy(constantFlow(kSize, 0, 0), trusted)(10, 60), 0);
  EXPECT_EQ(coveredBy(constantFlow(kSize, 0, 0), trusted)(60, 60), 1);
  // Between pixels each gets its part: half a pixel aside everything but the rim is still reached.
  EXPECT_EQ(cv::countNonZero(coveredBy(constantFlow(kSize, 0.5f, 0.5f), {})(cv::Rect(2, 2, 116, 86))), 116 * 86);
}

TEST(Consistent, IsWhereBothWaysLeadBack) {
  FlowPlanes there = constantFlow(kSize, 5, -3), back = constantFlow(kSize, -5, 3);
  back.u.row(40)[65] = -3;
  const cv::Mat1b agree = consistent(there, back, 1.5f, 1);
  EXPECT_EQ(agree(43, 60), 0);  // leads to (65, 40), which leads elsewhere
  EXPECT_EQ(agree(43, 61), 1);
  EXPECT_EQ(agree(1, 60), 0);    // leaves the image above
  EXPECT_EQ(agree(43, 117), 0);  // and to the right
  EXPECT_EQ(consistent(there, back, 2.5f, 1)(43, 60), 1);
}

TEST(Mismatch, IsTheDifferenceOfThreeChannelsAndSaturates) {
  Level level{
      cv::Mat4f(kSize, cv::Vec4f(0.5f, 0.5f, 0.5f, 0)), cv::Mat4f(kSize, cv::Vec4f(0.52f, 0.49f, 0.53f, 0.9f)), {}, {}};
  EXPECT_NEAR(windowMismatch(level, constantFlow(kSize, 0.3f, 0.6f), 2, 1).row(45)[60], 0.06, 1e-5);
  level.second.setTo(cv::Scalar::all(0.9));
  EXPECT_NEAR(windowMismatch(level, constantFlow(kSize, 0, 0), 2, 1).row(45)[60], kLargestMismatch, 1e-5);
  EXPECT_NEAR(windowMismatch(level, constantFlow(kSize, 200, 0), 2, 1).row(45)[60], kUnseen, 1e-5);
}

TEST(Mismatch, ReadsBetweenPixelsAndOnlyWhatCounts) {
  const auto ramp = [](float x, float y) { return 0.3f + 0.002f * x + 0.003f * y; };
  Level level{
      imageOf(kSize, [&](float x, float y) { return ramp(x + 1.5f, y - 0.25f); }), imageOf(kSize, ramp), {}, {}};
  const FlowPlanes flow = constantFlow(kSize, 1.5f, -0.25f);
  EXPECT_NEAR(windowMismatch(level, flow, 1, 1).row(45)[60], 0, 1e-5);
  EXPECT_NEAR(windowMismatch(level, constantFlow(kSize, 3.5f, -0.25f), 1, 1).row(45)[60], 3 * 0.004, 1e-5);
  level.second_valid = cv::Mat1b(kSize, uchar{1});
  level.second_valid(44, 61) = 0;  // of the nine around (60, 45) the middle leads there
  EXPECT_NEAR(windowMismatch(level, flow, 1, 1).row(45)[60], kUnseen / 9, 1e-5);
  EXPECT_EQ(shown(level, flow, 1)(45, 60), 0);
  EXPECT_EQ(shown(level, flow, 1)(45, 61), 1);
  EXPECT_EQ(shown(level, flow, 1)(0, 60), 0);
}

TEST(Mismatch, TheBetterOfTwoFlowsIsAdoptedWhereItMay) {
  const cv::Mat4f first = grains(kSize, 1);
  cv::Mat4f second = first.clone();
  first.colRange(0, 116).copyTo(second.colRange(4, 120));  // all moves by 4
  cv::Mat1b eligible(kSize, uchar{1});
  eligible.rowRange(0, 40).setTo(0);
  FlowPlanes flow = constantFlow(kSize, 0, 0);
  adoptWhereBetter({first, second, {}, {}}, constantFlow(kSize, 4, 0), eligible, flow, 1);
  EXPECT_EQ(flow.u.row(60)[60], 4);
  EXPECT_EQ(flow.u.row(20)[60], 0);
  adoptWhereBetter({first, second, {}, {}}, constantFlow(kSize, 1, 0), cv::Mat1b(kSize, uchar{1}), flow, 1);
  EXPECT_EQ(flow.u.row(60)[60], 4);
}

TEST(MismatchScale, FollowsWhatIsUsual) {
  const auto scaleAt = [](float usual) {
    Level level{cv::Mat4f(kSize, cv::Vec4f(0.5f, 0.5f, 0.5f, 0)),
                cv::Mat4f(kSize, cv::Vec4f(0.5f + usual, 0.5f, 0.5f, 0)),
                {},
                {}};
    return mismatchScale(level, constantFlow(kSize, 0, 0), 1);
  };
  EXPECT_NEAR(scaleAt(0.001f).suspect, 0.02, 1e-4);  // never less
  EXPECT_NEAR(scaleAt(0.01f).suspect, 0.04, 1e-4);   // four times what is usual
  EXPECT_NEAR(scaleAt(0.05f).suspect, 0.12, 1e-4);   // and not more
  EXPECT_NEAR(scaleAt(0.1f).suspect, 0.15, 1e-4);    // unless the usual itself is near
  EXPECT_NEAR(scaleAt(0.01f).unmatched, 0.065, 1e-4);
  EXPECT_NEAR(scaleAt(0.001f).unmatched, 0.04, 1e-4);
  EXPECT_NEAR(scaleAt(0.1f).unmatched, 0.17, 1e-4);
}

TEST(MismatchScale, TheUsualIsTheMedianOfTheImage) {
  const cv::Size size(9, 30);
  Level level{cv::Mat4f(size, cv::Vec4f(0.5f, 0.5f, 0.5f, 0)), cv::Mat4f(size, cv::Vec4f(0.5f, 0.5f, 0.5f, 0)), {}, {}};
  level.second.colRange(4, 9).setTo(cv::Scalar(0.51, 0.5, 0.5, 0));
  // Windows five wide: of the nine columns the fifth is in the middle, with 3 of 5 above.
  EXPECT_NEAR(mismatchScale(level, constantFlow(size, 0, 0), 1).suspect, 4 * 0.006, 1e-4);
}

}  // namespace
}  // namespace cortshift_flow
