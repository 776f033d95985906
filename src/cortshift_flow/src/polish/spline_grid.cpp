#include "polish/spline_grid.hpp"

#include <algorithm>
#include <vector>

#include "images/spline.hpp"
#include "parallel.hpp"

namespace cortshift_flow {
namespace {

constexpr int kSpacing = SplineGrid::kSpacing;

CORTSHIFT_VECTORISED
void blendRows(const float* a, const float* b, const float* c, const float* d, const float* w, float* out, int count) {
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) out[i] = (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]);
}

CORTSHIFT_VECTORISED
void expandRow(const float* nodes, const SplineGrid::Weights& weights, float* out, int cells) {
#pragma GCC ivdep
  for (int j = 0; j < cells; ++j)
    for (int p = 0; p < kSpacing; ++p)
      out[kSpacing * j + p] = (weights[p][0] * nodes[j] + weights[p][1] * nodes[j + 1]) +
                              (weights[p][2] * nodes[j + 2] + weights[p][3] * nodes[j + 3]);
}

CORTSHIFT_VECTORISED
void addWeighted(const float* in, float weight, float* out, int count) {
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) out[i] += weight * in[i];
}

/// phase[p * stride + j] = pixels[kSpacing * j + p]
CORTSHIFT_VECTORISED
void splitPhases(const float* pixels, float* __restrict__ phase, int stride, int cells) {
#pragma GCC ivdep
  for (int j = 0; j < cells; ++j)
    for (int p = 0; p < kSpacing; ++p) phase[p * stride + j] = pixels[kSpacing * j + p];
}

/// Node i is reached by the pixels of cells i - 3...i.
CORTSHIFT_VECTORISED
void gatherNodes(const float* phase, int stride, const SplineGrid::Weights& weights, float* __restrict__ nodes,
                 int count) {
  for (int i = 0; i < count; ++i) nodes[i] = 0;
  for (int p = 0; p < kSpacing; ++p) {
    const float *w = weights[static_cast<std::size_t>(p)].data(), *value = phase + p * stride;
#pragma GCC ivdep
    for (int i = 0; i < count; ++i)
      nodes[i] += (w[0] * value[i] + w[1] * value[i - 1]) + (w[2] * value[i - 2] + w[3] * value[i - 3]);
  }
}

}  // namespace

const SplineGrid::Weights& SplineGrid::weights() {
  static const Weights table = [] {
    Weights w{};
    std::array<float, 4> derivative{};
    for (int p = 0; p < kSpacing; ++p)
      splineWeights(static_cast<float>(p) / kSpacing, w[static_cast<std::size_t>(p)].data(), derivative.data());
    return w;
  }();
  return table;
}

void evaluateSplineRow(const Plane& nodes, int y, float* scratch, float* out, int width) {
  const int j = y / kSpacing;
  const SplineGrid::Weights& weights = SplineGrid::weights();
  blendRows(nodes.row(j), nodes.row(j + 1), nodes.row(j + 2), nodes.row(j + 3),
            weights[static_cast<std::size_t>(y % kSpacing)].data(), scratch, nodes.width());
  const int cells = width / kSpacing;
  expandRow(scratch, weights, out, cells);
  for (int x = kSpacing * cells; x < width; ++x) {
    const auto& w = weights[static_cast<std::size_t>(x % kSpacing)];
    out[x] =
        (w[0] * scratch[cells] + w[1] * scratch[cells + 1]) + (w[2] * scratch[cells + 2] + w[3] * scratch[cells + 3]);
  }
}

void reduceRow(const float* pixels, int width, float* nodes, int node_columns) {
  const SplineGrid::Weights& weights = SplineGrid::weights();
  const int cells = (width + kSpacing - 1) / kSpacing;
  constexpr int kMargin = 3;  // cells without pixels to the left and right
  const int stride = node_columns + 2 * kMargin;
  std::vector<float> phases(static_cast<std::size_t>(kSpacing * stride), 0.f);
  float* phase = phases.data() + kMargin;
  splitPhases(pixels, phase, stride, width / kSpacing);
  for (int x = width / kSpacing * kSpacing; x < width; ++x) phase[x % kSpacing * stride + cells - 1] = pixels[x];
  gatherNodes(phase, stride, weights, nodes, node_columns);
}

void reduceColumn(const Plane& reduced, int j, float* out) {
  const SplineGrid::Weights& weights = SplineGrid::weights();
  std::fill(out, out + reduced.width(), 0.f);
  for (int k = 3; k >= 0; --k)
    for (int p = 0; p < kSpacing; ++p) {
      const int y = kSpacing * (j - k) + p;
      if (y < 0 || y >= reduced.height()) continue;
      addWeighted(reduced.row(y), weights[static_cast<std::size_t>(p)][static_cast<std::size_t>(k)], out,
                  reduced.width());
    }
}

}  // namespace cortshift_flow
