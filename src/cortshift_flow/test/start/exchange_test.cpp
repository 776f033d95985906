// Pixels take the flow of their surroundings where it matches, and only there.
#include "start/exchange.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "textures.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(90, 70);  // no whole number of tiles
constexpr int kWindow = 2;
constexpr float kSuspect = 0.03f;

/// The first image and what is left of it after `flow`: the second image is sampled so that the flow is exact.
Level movedBy(const FlowPlanes& flow) {
  Level level{{}, grains(kSize, 3), {}, {}};
  cv::Mat1f x(kSize), y(kSize);
  for (int row = 0; row < kSize.height; ++row)
    for (int column = 0; column < kSize.width; ++column) {
      x(row, column) = static_cast<float>(column) + flow.u.row(row)[column];
      y(row, column) = static_cast<float>(row) + flow.v.row(row)[column];
    }
  cv::Mat first;
  cv::remap(level.second, first, x, y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  level.first = first;
  return level;
}

double gapAt(const FlowPlanes& a, const FlowPlanes& b, int x, int y) {
  return static_cast<double>(std::hypot(a.u.row(y)[x] - b.u.row(y)[x], a.v.row(y)[x] - b.v.row(y)[x]));
}

TEST(ExchangeFlow, AMotionSpreadsByItsReachInEveryDirection) {
  const FlowPlanes truth = constantFlow(kSize, 5, 3);
  const Level level = movedBy(truth);
  const cv::Rect known(35, 30, 12, 10);
  const auto start = [&] {
    return flowOf(kSize, [&](float x, float y) {
      return known.contains(cv::Point(static_cast<int>(x), static_cast<int>(y))) ? cv::Vec2f(5, 3) : cv::Vec2f(0, 0);
    });
  };
  FlowPlanes flow = start();
  exchangeFlow(level, {10}, kWindow, kSuspect, {}, flow, 1);
  for (int y = 5; y < kSize.height - 8; ++y)
    for (int x = 5; x < kSize.width - 10; ++x) {
      bool reached = false;  // by the whole window, so that what is tried there is the truth
      for (const cv::Point& way : {cv::Point(10, 0), {-10, 0}, {0, 10}, {0, -10}, {7, 7}, {-7, 7}, {7, -7}, {-7, -7}}) {
        const cv::Rect from(x + way.x - kWindow, y + way.y - kWindow, 2 * kWindow + 1, 2 * kWindow + 1);
        reached = reached || (from & known) == from;
      }
      if (reached) {
        EXPECT_LT(gapAt(flow, truth, x, y), 1e-5) << x << " " << y;
      }
      if (x < known.x - 22 || x > known.br().x + 22 || y < known.y - 22 || y > known.br().y + 22) {
        EXPECT_EQ(gapAt(flow, start(), x, y), 0) << x << " " << y;
      }
    }
  cv::Mat1b fixed(kSize, uchar{0});
  fixed.colRange(0, 45) = 1;
  FlowPlanes held = start();
  exchangeFlow(level, {10}, kWindow, kSuspect, fixed, held, 1);
  for (int x = 5; x < 80; ++x) EXPECT_EQ(gapAt(held, x < 45 ? start() : flow, x, 35), 0) << x;
}

TEST(ExchangeFlow, ASlopeIsContinued) {
  const FlowPlanes truth = flowOf(kSize, [](float x, float y) { return cv::Vec2f(0.25f * x - 9, 0.2f * y - 6); });
  const Level level = movedBy(truth);
  FlowPlanes flow = flowOf(
      kSize, [](float x, float y) { return x < 50 ? cv::Vec2f(0.25f * x - 9, 0.2f * y - 6) : cv::Vec2f(-9, 6); });
  exchangeFlow(level, {12}, kWindow, kSuspect, {}, flow, 1);
  for (int y = 14; y < kSize.height - 14; ++y)
    for (int x = 54; x < 60; ++x) EXPECT_LT(gapAt(flow, truth, x, y), 1e-4) << x << " " << y;
}

TEST(ExchangeFlow, WhatMatchesStaysAsItIs) {
  const FlowPlanes truth = constantFlow(kSize, 2, 1);
  const Level level = movedBy(truth);
  FlowPlanes flow = truth;
  for (int y = 20; y < 30; ++y) flow.u.row(y)[40] = 9;  // too thin for a window to see much of
  exchangeFlow(level, {4, 8}, kWindow, 1.f, {}, flow, 1);
  EXPECT_EQ(flow.u.row(25)[40], 9) << "nothing mismatches by 1 grey level of 1";
  EXPECT_EQ(gapAt(flow, truth, 10, 10), 0);
}

TEST(ExchangeFlow, SameBitsForOneAndManyThreads) {
  const Level level = movedBy(flowOf(kSize, [](float x, float y) { return cv::Vec2f(0.1f * y, -0.05f * x); }));
  FlowPlanes one = flowOf(kSize, [](float x, float) { return x < 45 ? cv::Vec2f(3, -2) : cv::Vec2f(0, 0); }),
             many = one;
  exchangeFlow(level, {5, 15}, kWindow, kSuspect, {}, one, 1);
  exchangeFlow(level, {5, 15}, kWindow, kSuspect, {}, many, 4);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) ASSERT_EQ(gapAt(one, many, x, y), 0);
}

}  // namespace
}  // namespace cortshift_flow
