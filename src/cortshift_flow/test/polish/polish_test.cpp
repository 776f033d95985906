// The spline surface of the polish: its nodes, its values, and the flow that it finds.
#include "polish/polish.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "images/spline.hpp"
#include "polish/spline_grid.hpp"
#include "textures.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(70, 50);

ImagePair still() { return {grains(kSize, 1), splineCoefficients(grains(kSize, 1), 1), {}, {}}; }

TEST(Polish, ASurfaceOfAnAffineFlowIsThatFlowUpToTheRim) {
  const auto affine = [](float x, float y) { return cv::Vec2f(1 + 0.1f * x - 0.2f * y, -2 + 0.05f * x + 0.15f * y); };
  PolishEffort effort;
  effort.linearisations = 0;
  const FlowPlanes start = flowOf(kSize, affine);
  const FlowPlanes flow = evaluate(polish(still(), {1, 1, 1, 0}, {}, start, effort, 1), constantFlow(kSize, 99, 99), 1);
  // One pixel beyond the image the nodes go on linearly, four pixels farther than it.
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      EXPECT_NEAR(flow.u.row(y)[x], start.u.row(y)[x], 2e-4) << x << " " << y;
      EXPECT_NEAR(flow.v.row(y)[x], start.v.row(y)[x], 2e-4) << x << " " << y;
    }
}

TEST(SplineGrid, ReducingIsTheTransposeOfEvaluating) {
  // <evaluate(nodes), pixels> = <nodes, reduce(pixels)> for any of either.
  const cv::Size size = SplineGrid::nodes(kSize);
  cv::RNG random(3);
  Plane nodes(size), pixels(kSize);
  for (int j = 0; j < size.height; ++j)
    for (int i = 0; i < size.width; ++i) nodes.row(j)[i] = static_cast<float>(random.uniform(-1.0, 1.0));
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) pixels.row(y)[x] = static_cast<float>(random.uniform(-1.0, 1.0));
  double left = 0, right = 0;
  std::vector<float> scratch(static_cast<std::size_t>(size.width)), row(static_cast<std::size_t>(kSize.width + 16)),
      column(static_cast<std::size_t>(size.width));
  Plane reduced(kSize.height, size.width);
  for (int y = 0; y < kSize.height; ++y) {
    evaluateSplineRow(nodes, y, scratch.data(), row.data(), kSize.width);
    for (int x = 0; x < kSize.width; ++x) left += row[static_cast<std::size_t>(x)] * pixels.row(y)[x];
    reduceRow(pixels.row(y), kSize.width, reduced.row(y), size.width);
  }
  for (int j = 0; j < size.height; ++j) {
    reduceColumn(reduced, j, column.data());
    for (int i = 0; i < size.width; ++i) right += nodes.row(j)[i] * column[static_cast<std::size_t>(i)];
  }
  EXPECT_NEAR(left, right, 1e-3);
  EXPECT_GT(std::abs(left), 0.1);
}

TEST(Polish, FindsAFractionOfAPixelAndKnowsWhereItDoes) {
  const auto wave = [](float x, float y) { return 0.5f + 0.2f * std::sin(0.5f * x + 0.1f * y) * std::cos(0.4f * y); };
  ImagePair pair{imageOf(kSize, wave),
                 splineCoefficients(imageOf(kSize, [&](float x, float y) { return wave(x - 0.3f, y + 0.2f); }), 1),
                 {},
                 {}};
  const PolishedFlow polished = polish(pair, {1e4f, 1e4f, 1e4f, 0}, {}, constantFlow(kSize, 0, 0), {}, 1);
  const FlowPlanes flow = evaluate(polished, constantFlow(kSize, 0, 0), 1);
  for (int y = 10; y < kSize.height - 10; y += 4)
    for (int x = 10; x < kSize.width - 10; x += 4) {
      EXPECT_NEAR(flow.u.row(y)[x], 0.3, 0.02) << x << " " << y;
      EXPECT_NEAR(flow.v.row(y)[x], -0.2, 0.02) << x << " " << y;
    }
  EXPECT_GT(polished.information.row(6)[8], 100);
  // Where nothing is visible there are no data, and the surface goes on smoothly.
  cv::Mat1b visible(kSize, uchar{1});
  visible(cv::Rect(0, 0, 35, kSize.height)) = 0;
  const PolishedFlow half = polish(pair, {1e4f, 1e4f, 1e4f, 0}, visible, constantFlow(kSize, 0, 0), {}, 1);
  EXPECT_EQ(half.information.row(6)[3], 0);
  EXPECT_GT(half.information.row(6)[15], 100);
}

TEST(Polish, AStepOfTheFlowIsABoundaryAndKeepsItsOwn) {
  const FlowPlanes start = flowOf(kSize, [](float x, float) { return cv::Vec2f(x < 36 ? 0.f : 6.f, 0); });
  PolishEffort effort;
  effort.linearisations = 1;
  effort.solver_iterations = 0;
  const PolishedFlow polished = polish(still(), {1, 1, 1, 0}, {}, start, effort, 1);
  EXPECT_EQ(polished.regular(5, 3), 1);
  EXPECT_EQ(polished.regular(5, 9), 0);  // cell of pixels 36...39
  EXPECT_EQ(polished.regular(5, 14), 1);
  EXPECT_EQ(evaluate(polished, start, 1).u.row(22)[37], 6);
}

}  // namespace
}  // namespace cortshift_flow
