#include "polish/node_solver.hpp"

#include <algorithm>
#include <array>
#include <numeric>

#include "cortshift_flow/vectorised.hpp"
#include "parallel.hpp"

namespace cortshift_flow {
namespace {

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

}  // namespace

NodeSolver::NodeSolver(cv::Size size, int threads)
    : size_(size), threads_(threads), row_sums_(static_cast<std::size_t>(size.height)) {
  for (Plane* p : {&stencils.xx, &stencils.yy, &stencils.xy, &data.xx, &data.xy, &data.yy, &data.u, &data.v, &q_u_.xx,
                   &q_u_.yy, &q_u_.xy, &q_v_.xx, &q_v_.yy, &q_v_.xy, &inverse_xx_, &inverse_xy_, &inverse_yy_})
    p->create(size.height, size.width);
  for (FlowPlanes* p : {&residual_, &direction_, &product_, &preconditioned_}) {
    p->u.create(size.height, size.width);
    p->v.create(size.height, size.width);
  }
}

void NodeSolver::solve(int iterations, FlowPlanes& x) {
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
      row_sums_[static_cast<std::size_t>(y)] =
          dotRow(direction_.u.row(y), product_.u.row(y), width) + dotRow(direction_.v.row(y), product_.v.row(y), width);
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

double NodeSolver::total() const { return std::accumulate(row_sums_.begin(), row_sums_.end(), 0.0); }

void NodeSolver::differences(const Plane& u, const Plane& v) {
  rows([&](int y) {
    differencesRow(u.row(y - 1), u.row(y), u.row(y + 1), stencils.xx.row(y), stencils.yy.row(y), stencils.xy.row(y),
                   q_u_.xx.row(y), q_u_.yy.row(y), q_u_.xy.row(y), size_.width);
    differencesRow(v.row(y - 1), v.row(y), v.row(y + 1), stencils.xx.row(y), stencils.yy.row(y), stencils.xy.row(y),
                   q_v_.xx.row(y), q_v_.yy.row(y), q_v_.xy.row(y), size_.width);
  });
}

void NodeSolver::applyRow(const Plane& u, const Plane& v, int y) {
  for (const auto& [q, out] : {std::pair(&q_u_, &product_.u), std::pair(&q_v_, &product_.v)})
    adjointRow(q->xx.row(y), q->yy.row(y - 1), q->yy.row(y), q->yy.row(y + 1), q->xy.row(y - 1), q->xy.row(y),
               out->row(y), size_.width);
  addDataRow(data.xx.row(y), data.xy.row(y), data.yy.row(y), u.row(y), v.row(y), product_.u.row(y), product_.v.row(y),
             size_.width);
}

double NodeSolver::preconditionAndDot(int y) {
  preconditionRow(inverse_xx_.row(y), inverse_xy_.row(y), inverse_yy_.row(y), residual_.u.row(y), residual_.v.row(y),
                  preconditioned_.u.row(y), preconditioned_.v.row(y), size_.width);
  return dotRow(residual_.u.row(y), preconditioned_.u.row(y), size_.width) +
         dotRow(residual_.v.row(y), preconditioned_.v.row(y), size_.width);
}

void NodeSolver::prepareDiagonal() {
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

}  // namespace cortshift_flow
