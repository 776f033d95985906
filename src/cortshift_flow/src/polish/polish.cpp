#include "polish/polish.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "parallel.hpp"
#include "polish/spline_grid.hpp"

namespace cortshift_flow {
namespace {

constexpr float kOrdinaryCurvature = 5.f;  // up to this multiple of the expected curvature, that one is used
constexpr double kNeighbourhood = 1.5;     // standard deviation of the window over which curvature is averaged [nodes]
constexpr float kRobust = 6.f;  // squared norm of a whitened residual at which its influence starts to saturate

/// Weights of the second differences about each node: along x, along y, and mixed (with the nodes right and below).
struct Stencils {
  Plane xx, yy, xy;
};

/// Data term per node: information matrix and right-hand side of the normal equations.
struct NodeData {
  Plane xx, xy, yy, u, v;
};

struct Vector {
  Plane u, v;
};

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

CORTSHIFT_VECTORISED
void differencesRow(const float* above, const float* here, const float* below, const float* wxx, const float* wyy,
                    const float* wxy, float* qxx, float* qyy, float* qxy, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    qxx[x] = wxx[x] * (here[x - 1] - 2 * here[x] + here[x + 1]);
    qyy[x] = wyy[x] * (above[x] - 2 * here[x] + below[x]);
    qxy[x] = wxy[x] * (below[x + 1] - below[x] - here[x + 1] + here[x]);
  }
}

CORTSHIFT_VECTORISED
void adjointRow(const float* qxx, const float* qyy_above, const float* qyy, const float* qyy_below,
                const float* qxy_above, const float* qxy, float* out, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x)
    out[x] = (qxx[x - 1] - 2 * qxx[x] + qxx[x + 1]) + (qyy_above[x] - 2 * qyy[x] + qyy_below[x]) +
             (qxy[x] - qxy[x - 1] - qxy_above[x] + qxy_above[x - 1]);
}

CORTSHIFT_VECTORISED
void addDataRow(const float* xx, const float* xy, const float* yy, const float* u, const float* v, float* out_u,
                float* out_v, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    out_u[x] += xx[x] * u[x] + xy[x] * v[x];
    out_v[x] += xy[x] * u[x] + yy[x] * v[x];
  }
}

CORTSHIFT_VECTORISED
void preconditionRow(const float* ixx, const float* ixy, const float* iyy, const float* u, const float* v, float* out_u,
                     float* out_v, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    out_u[x] = ixx[x] * u[x] + ixy[x] * v[x];
    out_v[x] = ixy[x] * u[x] + iyy[x] * v[x];
  }
}

CORTSHIFT_VECTORISED
void addScaledRow(const float* in, float factor, float* out, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) out[x] += factor * in[x];
}

CORTSHIFT_VECTORISED
void scaleAndAddRow(const float* in, float factor, float* out, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) out[x] = in[x] + factor * out[x];
}

/// Fixed number of partial sums, so that the bits do not depend on the vector width.
CORTSHIFT_VECTORISED
double dotRow(const float* a, const float* b, int width) {
  std::array<float, 16> sums{};
  int x = 0;
  for (; x + 16 <= width; x += 16)
    for (int k = 0; k < 16; ++k) sums[static_cast<std::size_t>(k)] += a[x + k] * b[x + k];
  for (; x < width; ++x) sums[0] += a[x] * b[x];
  double total = 0;
  for (const float sum : sums) total += sum;
  return total;
}

/// Conjugate gradients on (data + second-order smoothness) nodes = right-hand side.
class NodeSolver {
 public:
  NodeSolver(cv::Size size, int threads)
      : size_(size), threads_(threads), row_sums_(static_cast<std::size_t>(size.height)) {
    for (Plane* p : {&stencils.xx, &stencils.yy, &stencils.xy, &data.xx, &data.xy, &data.yy, &data.u, &data.v, &q_u_.xx,
                     &q_u_.yy, &q_u_.xy, &q_v_.xx, &q_v_.yy, &q_v_.xy, &inverse_xx_, &inverse_xy_, &inverse_yy_})
      p->create(size.height, size.width);
    for (Vector* p : {&residual_, &direction_, &product_, &preconditioned_}) {
      p->u.create(size.height, size.width);
      p->v.create(size.height, size.width);
    }
  }

  Stencils stencils;
  NodeData data;

  void solve(int iterations, FlowPlanes& x) {
    prepareDiagonal();
    const int width = size_.width;
    differences(x.u, x.v);
    rows([&](int y) {
      applyRow(x.u, x.v, y);
      const float *pu = product_.u.row(y), *pv = product_.v.row(y), *du = data.u.row(y), *dv = data.v.row(y);
      float *ru = residual_.u.row(y), *rv = residual_.v.row(y);
      for (int i = 0; i < width; ++i) {
        ru[i] = du[i] - pu[i];
        rv[i] = dv[i] - pv[i];
      }
      row_sums_[static_cast<std::size_t>(y)] = preconditionAndDot(y);
      std::copy_n(preconditioned_.u.row(y), width, direction_.u.row(y));
      std::copy_n(preconditioned_.v.row(y), width, direction_.v.row(y));
    });
    double energy = total();
    const double enough = 1e-9 * energy;
    for (int i = 0; i < iterations && energy > enough && energy > 0; ++i) {
      differences(direction_.u, direction_.v);
      rows([&](int y) {
        applyRow(direction_.u, direction_.v, y);
        row_sums_[static_cast<std::size_t>(y)] = dotRow(direction_.u.row(y), product_.u.row(y), width) +
                                                 dotRow(direction_.v.row(y), product_.v.row(y), width);
      });
      const double curvature = total();
      if (!(curvature > 0)) break;
      const auto step = static_cast<float>(energy / curvature);
      rows([&](int y) {
        addScaledRow(direction_.u.row(y), step, x.u.row(y), width);
        addScaledRow(direction_.v.row(y), step, x.v.row(y), width);
        addScaledRow(product_.u.row(y), -step, residual_.u.row(y), width);
        addScaledRow(product_.v.row(y), -step, residual_.v.row(y), width);
        row_sums_[static_cast<std::size_t>(y)] = preconditionAndDot(y);
      });
      const double next = total();
      const auto factor = static_cast<float>(next / energy);
      energy = next;
      rows([&](int y) {
        scaleAndAddRow(preconditioned_.u.row(y), factor, direction_.u.row(y), width);
        scaleAndAddRow(preconditioned_.v.row(y), factor, direction_.v.row(y), width);
      });
    }
  }

 private:
  template <typename Body>
  void rows(const Body& body) {
    forRows(size_.height, threads_, [&](int begin, int end) {
      for (int y = begin; y < end; ++y) body(y);
    });
  }

  double total() const { return std::accumulate(row_sums_.begin(), row_sums_.end(), 0.0); }

  /// Weighted second differences of both components.
  void differences(const Plane& u, const Plane& v) {
    rows([&](int y) {
      differencesRow(u.row(y - 1), u.row(y), u.row(y + 1), stencils.xx.row(y), stencils.yy.row(y), stencils.xy.row(y),
                     q_u_.xx.row(y), q_u_.yy.row(y), q_u_.xy.row(y), size_.width);
      differencesRow(v.row(y - 1), v.row(y), v.row(y + 1), stencils.xx.row(y), stencils.yy.row(y), stencils.xy.row(y),
                     q_v_.xx.row(y), q_v_.yy.row(y), q_v_.xy.row(y), size_.width);
    });
  }

  /// Row y of the system's product with (u, v), whose differences have been taken.
  void applyRow(const Plane& u, const Plane& v, int y) {
    for (const auto& [q, out] : {std::pair(&q_u_, &product_.u), std::pair(&q_v_, &product_.v)})
      adjointRow(q->xx.row(y), q->yy.row(y - 1), q->yy.row(y), q->yy.row(y + 1), q->xy.row(y - 1), q->xy.row(y),
                 out->row(y), size_.width);
    addDataRow(data.xx.row(y), data.xy.row(y), data.yy.row(y), u.row(y), v.row(y), product_.u.row(y), product_.v.row(y),
               size_.width);
  }

  double preconditionAndDot(int y) {
    preconditionRow(inverse_xx_.row(y), inverse_xy_.row(y), inverse_yy_.row(y), residual_.u.row(y), residual_.v.row(y),
                    preconditioned_.u.row(y), preconditioned_.v.row(y), size_.width);
    return dotRow(residual_.u.row(y), preconditioned_.u.row(y), size_.width) +
           dotRow(residual_.v.row(y), preconditioned_.v.row(y), size_.width);
  }

  void prepareDiagonal() {
    rows([&](int y) {
      const Stencils& s = stencils;
      for (int x = 0; x < size_.width; ++x) {
        const float diagonal = s.xx.row(y)[x - 1] + 4 * s.xx.row(y)[x] + s.xx.row(y)[x + 1] + s.yy.row(y - 1)[x] +
                               4 * s.yy.row(y)[x] + s.yy.row(y + 1)[x] + s.xy.row(y)[x] + s.xy.row(y)[x - 1] +
                               s.xy.row(y - 1)[x] + s.xy.row(y - 1)[x - 1];
        const float a = data.xx.row(y)[x] + diagonal, b = data.xy.row(y)[x], d = data.yy.row(y)[x] + diagonal;
        const float determinant = a * d - b * b;
        const float scale = determinant > 0 ? 1 / determinant : 0;
        inverse_xx_.row(y)[x] = d * scale;
        inverse_xy_.row(y)[x] = -b * scale;
        inverse_yy_.row(y)[x] = a * scale;
      }
    });
  }

  cv::Size size_;
  int threads_;
  std::vector<double> row_sums_;
  Stencils q_u_, q_v_;  // weighted second differences
  Plane inverse_xx_, inverse_xy_, inverse_yy_;
  Vector residual_, direction_, product_, preconditioned_;
};

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
