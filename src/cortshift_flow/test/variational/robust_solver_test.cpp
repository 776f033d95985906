// The minimiser of Eq. (5): it finds the flow that the data give and smooths where they give none.
#include "variational/robust_solver.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "textures.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(40, 30);

/// Data that ask for (u, v) with the same weight at every pixel.
MotionTensor askingFor(float u, float v, float weight) {
  MotionTensor tensor;
  tensor.create(kSize);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      tensor.xx.row(y)[x] = tensor.yy.row(y)[x] = weight;
      tensor.xt.row(y)[x] = -weight * u;
      tensor.yt.row(y)[x] = -weight * v;
      tensor.tt.row(y)[x] = weight * (u * u + v * v);
    }
  return tensor;
}

FlowPlanes minimised(const MotionTensor& tensor, const FlowPlanes& start, const Plane& edges = {}, int sweeps = 60) {
  FlowPlanes flow = start;
  LinkedSystem system;
  system.create(kSize);
  minimise(tensor, start.u, start.v, edges, RobustEnergy(), 4, sweeps, system, flow.u, flow.v, 1);
  return flow;
}

TEST(Minimise, EndsWhereTheDataAsk) {
  // The tensor is linearised about the start: what is asked for comes on top of it.
  const FlowPlanes flow = minimised(askingFor(0.4f, -0.3f, 1), constantFlow(kSize, 2, 1));
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x) {
      EXPECT_NEAR(flow.u.row(y)[x], 2.4, 1e-3);
      EXPECT_NEAR(flow.v.row(y)[x], 0.7, 1e-3);
    }
}

TEST(Minimise, FillsWhereThereAreNoData) {
  MotionTensor tensor = askingFor(0.4f, -0.3f, 1);
  for (int y = 12; y < 16; ++y)
    for (int x = 18; x < 22; ++x)
      for (Plane* plane : {&tensor.xx, &tensor.yy, &tensor.xt, &tensor.yt, &tensor.tt}) plane->row(y)[x] = 0;
  const FlowPlanes flow = minimised(tensor, constantFlow(kSize, 0, 0), {}, 200);
  EXPECT_NEAR(flow.u.row(14)[20], 0.4, 0.01);
  EXPECT_NEAR(flow.v.row(14)[20], -0.3, 0.01);
}

TEST(Minimise, NothingCrossesAnEdgeOfWeightZero) {
  MotionTensor tensor = askingFor(1, 0, 1);
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 20; x < kSize.width; ++x)
      for (Plane* plane : {&tensor.xx, &tensor.yy, &tensor.xt, &tensor.yt, &tensor.tt}) plane->row(y)[x] = 0;
  Plane edges(kSize, 1);
  for (int y = 0; y < kSize.height; ++y) edges.row(y)[19] = edges.row(y)[20] = 0;
  const FlowPlanes flow = minimised(tensor, constantFlow(kSize, 0, 0), edges);
  EXPECT_NEAR(flow.u.row(15)[10], 1, 0.01);
  EXPECT_NEAR(flow.u.row(15)[30], 0, 0.01);
}

TEST(Minimise, IsTheSameAlongRowsAndColumns) {
  const cv::Size square(30, 30);
  const auto solved = [&](bool turned) {
    MotionTensor tensor;
    tensor.create(square);
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 30; ++x) {
        const float pull = (turned ? y : x) < 15 ? 0.5f : 0.f;
        tensor.xx.row(y)[x] = tensor.yy.row(y)[x] = 0.01f;
        tensor.xt.row(y)[x] = -0.01f * pull;
        tensor.tt.row(y)[x] = 0.01f * pull * pull;
      }
    FlowPlanes flow{Plane(square), Plane(square)};
    LinkedSystem system;
    system.create(square);
    minimise(tensor, flow.u, flow.v, {}, RobustEnergy(), 2, 300, system, flow.u, flow.v, 1);
    return flow;
  };
  const FlowPlanes a = solved(false), b = solved(true);
  for (int i = 0; i < 30; ++i)
    for (int k = 0; k < 30; ++k) EXPECT_NEAR(a.u.row(i)[k], b.u.row(k)[i], 2e-3) << i << " " << k;
}

}  // namespace
}  // namespace cortshift_flow
