#include "trust/flow_steps.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace cortshift_flow {
namespace {

const cv::Size kSize(64, 48);
constexpr int kMiddle = 32;

/// (u, v) = (across(x), up(y))
template <typename Across, typename Up>
FlowPlanes flowOf(const Across& across, const Up& up) {
  FlowPlanes flow{Plane(kSize), Plane(kSize)};
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      flow.u.row(y)[x] = across(static_cast<float>(x));
      flow.v.row(y)[x] = up(static_cast<float>(y));
    }
  return flow;
}

TEST(FlowSteps, AVectorBesideAStepIsThatOfEitherSide) {
  constexpr float kStep = 1.8f;
  const cv::Mat1f error =
      errorBesideSteps(flowOf([](float x) { return x < kMiddle ? 0.f : kStep; }, [](float) { return 4.f; }));
  for (int x = 0; x < kSize.width; ++x) {
    const int away = x < kMiddle ? kMiddle - 1 - x : x - kMiddle;
    EXPECT_FLOAT_EQ(error(20, x), away < 3 ? 0.5f * kStep : 0) << x;
  }
}

TEST(FlowSteps, ASlopeIsNoStep) {
  const cv::Mat1f error =
      errorBesideSteps(flowOf([](float x) { return 0.3f * x; }, [](float y) { return 20 - 0.2f * y; }));
  EXPECT_LT(cv::norm(error, cv::NORM_INF), 1e-5);
}

TEST(FlowSteps, AStepOnASlopeIsFoundWithItsSize) {
  const cv::Mat1f error =
      errorBesideSteps(flowOf([](float x) { return 0.1f * x + (x < kMiddle ? 0.f : 2.f); }, [](float) { return 0.f; }));
  EXPECT_NEAR(error(20, kMiddle), 1, 1e-5);
  EXPECT_NEAR(error(20, kMiddle + 8), 0, 1e-5);
}

}  // namespace
}  // namespace cortshift_flow
