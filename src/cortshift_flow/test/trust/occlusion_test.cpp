// What is hidden, and how the flow goes on behind it, on motions that are known.
#include "trust/occlusion.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "textures.hpp"

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

}  // namespace
}  // namespace cortshift_flow
