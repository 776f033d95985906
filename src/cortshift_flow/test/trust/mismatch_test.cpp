// How differently two images look under a flow, against the same said slowly.
#include "trust/mismatch.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "textures.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(150, 40);

/// As mismatch.hpp says it, in double precision.
double mismatchAt(const Level& level, const FlowPlanes& flow, int x, int y) {
  const double px = x + static_cast<double>(flow.u.row(y)[x]), py = y + static_cast<double>(flow.v.row(y)[x]);
  const int ix = static_cast<int>(std::floor(px)), iy = static_cast<int>(std::floor(py));
  if (px < 0 || py < 0 || ix + 1 >= kSize.width || iy + 1 >= kSize.height) return static_cast<double>(kUnseen);
  if (!level.first_valid.empty() && !level.first_valid(y, x)) return static_cast<double>(kUnseen);
  if (!level.second_valid.empty() && !level.second_valid(iy, ix)) return static_cast<double>(kUnseen);
  double sum = 0;
  for (int c = 0; c < 3; ++c) {
    const auto at = [&](int dx, int dy) { return static_cast<double>(level.second(iy + dy, ix + dx)[c]); };
    const double fx = px - ix, fy = py - iy;
    sum += std::abs((1 - fy) * ((1 - fx) * at(0, 0) + fx * at(1, 0)) + fy * ((1 - fx) * at(0, 1) + fx * at(1, 1)) -
                    static_cast<double>(level.first(y, x)[c]));
  }
  return std::min(sum, static_cast<double>(kLargestMismatch));
}

/// Two images that look alike here and differ there, a flow that also leads out of them, and masks.
struct Scene {
  Scene() {
    level.second = level.first + 0.15 * (grains(kSize, 2) - cv::Scalar::all(0.5));
    cv::RNG random(5);
    for (int y = 0; y < kSize.height; ++y)
      for (int x = 0; x < kSize.width; ++x) {
        flow.u.row(y)[x] = static_cast<float>(random.uniform(-1.5, 1.5));
        flow.v.row(y)[x] = static_cast<float>(random.uniform(-1.5, 1.5));
      }
    level.first_valid = cv::Mat1b(kSize, uchar{1});
    level.first_valid(cv::Rect(20, 5, 9, 4)) = 0;
    level.second_valid = cv::Mat1b(kSize, uchar{1});
    level.second_valid(cv::Rect(80, 15, 5, 8)) = 0;
  }
  Level level{grains(kSize, 1), {}, {}, {}};
  FlowPlanes flow{Plane(kSize), Plane(kSize)};
};

TEST(Mismatch, IsTheBilinearDifferenceSummedOverTheChannels) {
  const Scene scene;
  std::vector<float> row(static_cast<std::size_t>(kSize.width));
  int saturated = 0, unseen = 0;
  for (int y = 0; y < kSize.height; ++y)
    for (const int from : {0, 7}) {
      const int count = kSize.width - 2 * from;
      mismatchRow(scene.level, from, y, scene.flow.u.row(y) + from, scene.flow.v.row(y) + from, row.data(), count);
      for (int i = 0; i < count; ++i) {
        const float value = row[static_cast<std::size_t>(i)];
        ASSERT_NEAR(value, mismatchAt(scene.level, scene.flow, from + i, y), 1e-5) << from + i << " " << y;
        saturated += value == kLargestMismatch;
        unseen += value == kUnseen;
      }
    }
  EXPECT_GT(saturated, 100);
  EXPECT_GT(unseen, 200);
}

TEST(Mismatch, OfAWindowIsItsMean) {
  const Scene scene;
  const int window = 2;
  const Plane mean = windowMismatch(scene.level, scene.flow, window, 1);
  for (int y = 0; y < kSize.height; y += 3)
    for (int x = 0; x < kSize.width; x += 3) {
      double sum = 0;
      for (int dy = -window; dy <= window; ++dy)
        for (int dx = -window; dx <= window; ++dx)  // the rim goes on as it ends
          sum += mismatchAt(scene.level, scene.flow, std::clamp(x + dx, 0, kSize.width - 1),
                            std::clamp(y + dy, 0, kSize.height - 1));
      ASSERT_NEAR(mean.row(y)[x], sum / 25, 1e-5) << x << " " << y;
    }
}

TEST(Mismatch, WhatIsAMismatchFollowsWhatIsUsual) {
  const auto scale = [](float usual) {
    Level level{cv::Mat4f(kSize, cv::Vec4f::all(0.5f)), cv::Mat4f(kSize, cv::Vec4f::all(0.5f + usual / 3)), {}, {}};
    return mismatchScale(level, constantFlow(kSize, 0, 0), 1);
  };
  for (const auto& [usual, suspect, unmatched] : {std::array<float, 3>{0.f, 0.02f, 0.04f},
                                                  {0.004f, 0.02f, 0.04f},
                                                  {0.01f, 0.04f, 0.065f},
                                                  {0.02f, 0.08f, 0.065f},
                                                  {0.05f, 0.12f, 0.085f},
                                                  {0.1f, 0.15f, 0.17f}}) {
    EXPECT_NEAR(scale(usual).suspect, suspect, 1e-5) << usual;
    EXPECT_NEAR(scale(usual).unmatched, unmatched, 1e-5) << usual;
  }
}

TEST(Mismatch, WhatIsUsualIsTheMedianOfTheImage) {
  const cv::Size size(9, 30);
  Level level{cv::Mat4f(size, cv::Vec4f(0.5f, 0.5f, 0.5f, 0)), cv::Mat4f(size, cv::Vec4f(0.5f, 0.5f, 0.5f, 0)), {}, {}};
  level.second.colRange(4, 9).setTo(cv::Scalar(0.51, 0.5, 0.5, 0));
  // Windows five wide: of the nine columns the fifth is in the middle, with 3 of 5 above.
  EXPECT_NEAR(mismatchScale(level, constantFlow(size, 0, 0), 1).suspect, 4 * 0.006, 1e-4);
}

TEST(Mismatch, ShownIsWhatBothImagesHave) {
  const Scene scene;
  const cv::Mat1b seen = shown(scene.level, scene.flow, 1);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      const float px = static_cast<float>(x) + scene.flow.u.row(y)[x],
                  py = static_cast<float>(y) + scene.flow.v.row(y)[x];
      const bool inside = px >= 0 && py >= 0 && px <= 149 && py <= 39;
      ASSERT_EQ(seen(y, x), inside && scene.level.first_valid(y, x) &&
                                scene.level.second_valid(static_cast<int>(py), static_cast<int>(px)))
          << x << " " << y;
    }
  const Level still{scene.level.first, scene.level.first, {}, {}};
  EXPECT_EQ(cv::countNonZero(shown(still, constantFlow(kSize, 0, 0), 1)), kSize.area());
}

TEST(Mismatch, MatchedIsWhatIsShownAndLooksAlike) {
  const Scene scene;
  const Plane mean = windowMismatch(scene.level, scene.flow, kMatchWindow, 1);
  const cv::Mat1b seen = shown(scene.level, scene.flow, 1), alike = matched(scene.level, scene.flow, 0.15f, 1);
  int both = 0;
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      ASSERT_EQ(alike(y, x), seen(y, x) && mean.row(y)[x] <= 0.15f);
      both += alike(y, x);
    }
  EXPECT_GT(both, 500);
  EXPECT_LT(both, 5000);
}

TEST(AdoptWhereBetter, TakesTheOtherFlowOnlyWhereItMatchesAndMay) {
  Level level{grains(kSize, 1), {}, {}, {}};
  cv::Mat moved;
  const cv::Mat shift = (cv::Mat_<double>(2, 3) << 1, 0, 4, 0, 1, 0);
  cv::warpAffine(level.first, moved, shift, kSize, cv::INTER_NEAREST, cv::BORDER_REFLECT);
  level.second = level.first.clone();
  moved.colRange(75, 150).copyTo(level.second.colRange(75, 150));  // the right half moved by 4 px
  cv::Mat1b eligible(kSize, uchar{1});
  eligible.rowRange(0, 10) = 0;
  FlowPlanes flow = constantFlow(kSize, 0, 0);
  adoptWhereBetter(level, constantFlow(kSize, 4, 0.01f), eligible, flow, 1);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 5; x < kSize.width - 12; ++x) {
      if (std::abs(x - 75) < 9) continue;
      EXPECT_EQ(flow.u.row(y)[x], x > 75 && y >= 10 ? 4.f : 0.f) << x << " " << y;
      EXPECT_EQ(flow.v.row(y)[x], x > 75 && y >= 10 ? 0.01f : 0.f) << x << " " << y;
    }
}

}  // namespace
}  // namespace cortshift_flow
