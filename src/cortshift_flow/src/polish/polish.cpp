#include "polish/polish.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "parallel.hpp"
#include "polish/node_solver.hpp"
#include "polish/spline_grid.hpp"

namespace cortshift_flow {
namespace {

constexpr float kOrdinaryCurvature = 5.f;  // up to this multiple of the expected curvature, that one is used
constexpr double kNeighbourhood = 1.5;     // standard deviation of the window over which curvature is averaged [nodes]
constexpr float kRobust = 6.f;  // squared norm of a whitened residual at which its influence starts to saturate

/// Second differences a - 2b + c.
float second(float a, float b, float c) { return a - 2 * b + c; }

/// Squares of the second differences about each node, both components together [px^2].
Stencils squaredDifferences(const FlowPlanes& nodes, int threads) {
  const int width = nodes.u.width(), height = nodes.u.height();
  Stencils s;
  for (Plane* p : {&s.xx, &s.yy, &s.xy}) p->create(height, width);
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      const float *u = nodes.u.row(y), *v = nodes.v.row(y), *ua = nodes.u.row(y - 1), *va = nodes.v.row(y - 1),
                  *ub = nodes.u.row(y + 1), *vb = nodes.v.row(y + 1);
      float *xx = s.xx.row(y), *yy = s.yy.row(y), *xy = s.xy.row(y);
      const auto square = [](float a, float b) { return a * a + b * b; };
      for (int x = 1; x < width - 1; ++x)
        xx[x] = square(second(u[x - 1], u[x], u[x + 1]), second(v[x - 1], v[x], v[x + 1]));
      if (y > 0 && y < height - 1)
        for (int x = 0; x < width; ++x) yy[x] = square(second(ua[x], u[x], ub[x]), second(va[x], v[x], vb[x]));
      if (y < height - 1)
        for (int x = 0; x < width - 1; ++x)
          xy[x] = square(ub[x + 1] - ub[x] - u[x + 1] + u[x], vb[x + 1] - vb[x] - v[x + 1] + v[x]);
    }
  });
  return s;
}

/// Mean square of the second differences around each node [px^2]; those above `break_at` (a motion boundary) count as
/// `break_at`.
cv::Mat1f meanCurvature(const Stencils& squares, float break_at) {
  const int width = squares.xx.width(), height = squares.xx.height();
  cv::Mat1f sum(height, width), mean;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      sum(y, x) = std::min(squares.xx.row(y)[x] + squares.yy.row(y)[x] + 2 * squares.xy.row(y)[x], break_at * break_at);
  cv::GaussianBlur(sum, mean, cv::Size(), kNeighbourhood);
  return mean;
}

/// The prior: how much the flow is expected to curve, and which second difference is a boundary.
struct Prior {
  float curvature;  ///< expected second difference [px]
  float break_at;   ///< [px]
  bool follow;      ///< expect more where the present flow curves more
};

/// Turns squared second differences into their weights in the energy. A weight is the inverse square of the curvature
/// that is expected around the node: the prior's, or what the whole neighbourhood shows where that is much more. (A
/// single large difference is noise; a neighbourhood of them is tissue that bends.) Across a motion boundary the
/// weight falls to 0 (redescending, after Geman and McClure).
void weigh(const Prior& prior, Stencils& s, int threads) {
  const int width = s.xx.width(), height = s.xx.height();
  const float square_curvature = prior.curvature * prior.curvature;
  const float inverse_square_break = 1 / (prior.break_at * prior.break_at);
  const cv::Mat1f mean = prior.follow ? meanCurvature(s, prior.break_at) : cv::Mat1f(height, width, 0.f);
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      float *xx = s.xx.row(y), *yy = s.yy.row(y), *xy = s.xy.row(y);
      const float* around = mean.ptr<float>(y);
      for (int x = 0; x < width; ++x) {
        const float weight = 1 / (square_curvature + around[x] * (1 / (kOrdinaryCurvature * kOrdinaryCurvature)));
        const auto connection = [&](float square) {
          const float ratio = 1 + square * inverse_square_break;
          return weight / (ratio * ratio);
        };
        xx[x] = x > 0 && x < width - 1 ? connection(xx[x]) : 0;
        yy[x] = y > 0 && y < height - 1 ? connection(yy[x]) : 0;
        xy[x] = x < width - 1 && y < height - 1 ? 2 * connection(xy[x]) : 0;  // twice: h_xy and h_yx
      }
    }
  });
}

/// Nodes from the flow at the pixels they lie on; beyond the image continued linearly.
void sampleNodes(const Plane& pixels, Plane& nodes) {
  constexpr int kSpacing = SplineGrid::kSpacing;
  const auto value = [&](int x, int y) {
    const int cx = std::clamp(x, 0, pixels.width() - 1), cy = std::clamp(y, 0, pixels.height() - 1);
    const float at = pixels.row(cy)[cx];
    const float mirrored =
        pixels.row(std::clamp(2 * cy - y, 0, pixels.height() - 1))[std::clamp(2 * cx - x, 0, pixels.width() - 1)];
    return x == cx && y == cy ? at : 2 * at - mirrored;
  };
  for (int j = 0; j < nodes.height(); ++j)
    for (int i = 0; i < nodes.width(); ++i) nodes.row(j)[i] = value(kSpacing * (i - 1), kSpacing * (j - 1));
}

/// Cells whose sixteen nodes form one smooth surface: no second difference among them is a boundary.
void findRegularCells(const FlowPlanes& nodes, float break_at, cv::Mat1b& regular) {
  const int width = nodes.u.width(), height = nodes.u.height();
  cv::Mat1b broken(height, width, uchar{0});  // bits: along x, along y, mixed
  const float limit = break_at * break_at;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const auto square = [&](auto difference) {
        const float u = difference(nodes.u), v = difference(nodes.v);
        return u * u + v * v;
      };
      uchar bits = 0;
      if (x > 0 && x < width - 1 &&
          square([&](const Plane& p) { return second(p.row(y)[x - 1], p.row(y)[x], p.row(y)[x + 1]); }) > limit)
        bits |= 1;
      if (y > 0 && y < height - 1 &&
          square([&](const Plane& p) { return second(p.row(y - 1)[x], p.row(y)[x], p.row(y + 1)[x]); }) > limit)
        bits |= 2;
      if (x < width - 1 && y < height - 1 && square([&](const Plane& p) {
                                               return p.row(y + 1)[x + 1] - p.row(y + 1)[x] - p.row(y)[x + 1] +
                                                      p.row(y)[x];
                                             }) > limit)
        bits |= 4;
      broken(y, x) = bits;
    }
  for (int j = 0; j < regular.rows; ++j)
    for (int i = 0; i < regular.cols; ++i) {
      uchar any = 0;
      for (int b = 0; b < 4; ++b)
        for (int a = 0; a < 4; ++a) {
          uchar relevant = broken(j + b, i + a);
          if (a == 0 || a == 3) relevant &= ~1;
          if (b == 0 || b == 3) relevant &= ~2;
          if (a == 3 || b == 3) relevant &= ~4;
          any |= relevant;
        }
      regular(j, i) = any == 0;
    }
}

struct ReducedRows {
  Plane xx, xy, yy, xt, yt;
};

/// Linearises the data about the present nodes and adds it up per node.
void assembleData(const ImagePair& images, const cv::Vec4f& channel_weights, const cv::Mat1b& visible,
                  const PolishedFlow& flow, ReducedRows& reduced, NodeData& data, int threads) {
  const int width = images.first.cols, height = images.first.rows, columns = flow.nodes.u.width();
  forRows(height, threads, [&](int begin, int end) {
    const auto size = static_cast<std::size_t>(width + 16);
    std::vector<float> scratch(static_cast<std::size_t>(columns)), u(size), v(size);
    RowScratch landing;
    std::array<std::vector<float>, 6> tensor;
    for (auto& row : tensor) row.resize(size);
    const TensorRow t{tensor[0].data(), tensor[1].data(), tensor[2].data(),
                      tensor[3].data(), tensor[4].data(), tensor[5].data()};
    for (int y = begin; y < end; ++y) {
      evaluateRow(flow, y, scratch.data(), u.data(), v.data(), width);
      lineariseRow(images, y, u.data(), v.data(), channel_weights, landing, t);
      const uchar* seen = visible.empty() ? nullptr : visible.ptr(y);
      const uchar* regular = flow.regular.ptr(y / SplineGrid::kSpacing);
      for (int x = 0; x < width; ++x) {
        const bool counts = regular[x / SplineGrid::kSpacing] && (!seen || seen[x]);
        const float weight = counts ? 1 / std::sqrt(1 + t.tt[x] * (1 / kRobust)) : 0.f;
        t.xx[x] *= weight;
        t.xy[x] *= weight;
        t.yy[x] *= weight;
        t.xt[x] *= weight;
        t.yt[x] *= weight;
      }
      reduceRow(t.xx, width, reduced.xx.row(y), columns);
      reduceRow(t.xy, width, reduced.xy.row(y), columns);
      reduceRow(t.yy, width, reduced.yy.row(y), columns);
      reduceRow(t.xt, width, reduced.xt.row(y), columns);
      reduceRow(t.yt, width, reduced.yt.row(y), columns);
    }
  });
  forRows(flow.nodes.u.height(), threads, [&](int begin, int end) {
    std::vector<float> xt(static_cast<std::size_t>(columns)), yt(static_cast<std::size_t>(columns));
    for (int j = begin; j < end; ++j) {
      float *xx = data.xx.row(j), *xy = data.xy.row(j), *yy = data.yy.row(j);
      reduceColumn(reduced.xx, j, xx);
      reduceColumn(reduced.xy, j, xy);
      reduceColumn(reduced.yy, j, yy);
      reduceColumn(reduced.xt, j, xt.data());
      reduceColumn(reduced.yt, j, yt.data());
      const float *u = flow.nodes.u.row(j), *v = flow.nodes.v.row(j);
      for (int i = 0; i < columns; ++i) {
        data.u.row(j)[i] = xx[i] * u[i] + xy[i] * v[i] - xt[static_cast<std::size_t>(i)];
        data.v.row(j)[i] = xy[i] * u[i] + yy[i] * v[i] - yt[static_cast<std::size_t>(i)];
      }
    }
  });
}

}  // namespace

void evaluateRow(const PolishedFlow& flow, int y, float* scratch, float* u, float* v, int width) {
  evaluateSplineRow(flow.nodes.u, y, scratch, u, width);
  evaluateSplineRow(flow.nodes.v, y, scratch, v, width);
}

FlowPlanes evaluate(const PolishedFlow& polished, const FlowPlanes& otherwise, int threads) {
  FlowPlanes flow{Plane(otherwise.u.size()), Plane(otherwise.u.size())};
  const int width = otherwise.u.width();
  forRows(otherwise.u.height(), threads, [&](int begin, int end) {
    std::vector<float> scratch(static_cast<std::size_t>(polished.nodes.u.width()));
    for (int y = begin; y < end; ++y) {
      evaluateRow(polished, y, scratch.data(), flow.u.row(y), flow.v.row(y), width);
      const uchar* regular = polished.regular.ptr(y / SplineGrid::kSpacing);
      for (int x = 0; x < width; ++x) {
        if (regular[x / SplineGrid::kSpacing]) continue;
        flow.u.row(y)[x] = otherwise.u.row(y)[x];
        flow.v.row(y)[x] = otherwise.v.row(y)[x];
      }
    }
  });
  return flow;
}

PolishedFlow polish(const ImagePair& images, const cv::Vec4f& channel_weights, const cv::Mat1b& visible,
                    const FlowPlanes& start, const PolishEffort& effort, int threads) {
  const cv::Size pixels = images.first.size(), size = SplineGrid::nodes(pixels);
  PolishedFlow flow;
  flow.nodes = {Plane(size), Plane(size)};
  sampleNodes(start.u, flow.nodes.u);
  sampleNodes(start.v, flow.nodes.v);
  flow.regular = cv::Mat1b(size.height - 3, size.width - 3, uchar{1});

  NodeSolver solver(size, threads);
  ReducedRows reduced;
  for (Plane* p : {&reduced.xx, &reduced.xy, &reduced.yy, &reduced.xt, &reduced.yt})
    p->create(pixels.height, size.width);
  for (int i = 0; i < effort.linearisations; ++i) {
    solver.stencils = squaredDifferences(flow.nodes, threads);
    weigh({effort.curvature, effort.break_at, i >= effort.stiff_linearisations}, solver.stencils, threads);
    findRegularCells(flow.nodes, effort.break_at, flow.regular);
    assembleData(images, channel_weights, visible, flow, reduced, solver.data, threads);
    solver.solve(effort.solver_iterations, flow.nodes);
  }
  flow.information = Plane(size);
  for (int j = 0; j < size.height; ++j)
    for (int i = 0; i < size.width; ++i) {
      const float a = solver.data.xx.row(j)[i], b = solver.data.xy.row(j)[i], d = solver.data.yy.row(j)[i];
      flow.information.row(j)[i] = 0.5f * (a + d - std::sqrt((a - d) * (a - d) + 4 * b * b));
    }
  return flow;
}

}  // namespace cortshift_flow
