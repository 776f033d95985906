#include "variational/robust_solver.hpp"

#include <algorithm>
#include <cmath>

#include "parallel.hpp"

namespace cortshift_flow {
namespace {

constexpr float kOverRelaxation = 1.85f;

/// phi'(|grad u|^2 + |grad v|^2) of Eq. (4), up to the factor 1/2 that psi' shares; forward differences.
CORTSHIFT_VECTORISED
void diffusivityRow(const float* u, const float* u_below, const float* v, const float* v_below, const float* edge,
                    float epsilon, float alpha, float* out, int width) {
  const float e2 = epsilon * epsilon;
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    const float ux = u[x + 1] - u[x], uy = u_below[x] - u[x], vx = v[x + 1] - v[x], vy = v_below[x] - v[x];
    out[x] = alpha / std::sqrt(ux * ux + uy * uy + vx * vx + vy * vy + e2);
  }
  if (edge)
    for (int x = 0; x < width; ++x) out[x] *= edge[x];
}

CORTSHIFT_VECTORISED
void linkRow(const float* diffusivity, const float* diffusivity_below, float* right, float* below, int width) {
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    right[x] = 0.5f * (diffusivity[x] + diffusivity[x + 1]);
    below[x] = 0.5f * (diffusivity[x] + diffusivity_below[x]);
  }
}

struct AssembleRow {
  const float *xx, *xy, *yy, *xt, *yt, *tt, *u0, *v0, *u, *v, *right, *below, *below_of_above;
  float *ixx, *ixy, *iyy, *cu, *cv;
};

CORTSHIFT_VECTORISED
void assembleRow(const AssembleRow& r, float epsilon, int width) {
  const float *xx = r.xx, *xy = r.xy, *yy = r.yy, *xt = r.xt, *yt = r.yt, *tt = r.tt, *u0 = r.u0, *v0 = r.v0, *u = r.u,
              *v = r.v, *right = r.right, *below = r.below, *above = r.below_of_above;
  float* __restrict__ ixx = r.ixx, * __restrict__ ixy = r.ixy, * __restrict__ iyy = r.iyy, * __restrict__ cu = r.cu, * __restrict__ cv = r.cv;
  const float e2 = epsilon * epsilon;
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    const float du = u[x] - u0[x], dv = v[x] - v0[x];
    const float square = tt[x] + 2 * (du * xt[x] + dv * yt[x]) + du * (du * xx[x] + 2 * dv * xy[x]) + dv * dv * yy[x];
    const float weight = 1 / std::sqrt(std::max(square, 0.f) + e2);  // psi' of Eq. (3)
    const float links = right[x] + right[x - 1] + below[x] + above[x];
    const float a = weight * xx[x] + links, b = weight * xy[x], d = weight * yy[x] + links;
    const float determinant = a * d - b * b;
    const float scale = determinant > 0 ? 1 / determinant : 0;
    ixx[x] = d * scale;
    ixy[x] = -b * scale;
    iyy[x] = a * scale;
    cu[x] = weight * (xx[x] * u0[x] + xy[x] * v0[x] - xt[x]);
    cv[x] = weight * (xy[x] * u0[x] + yy[x] * v0[x] - yt[x]);
  }
}

struct SweepRow {
  const float *ixx, *ixy, *iyy, *cu, *cv, *right, *below, *below_of_above, *u_above, *u_below, *v_above, *v_below;
};

/// Relaxes the pixels of one colour of a chessboard. All pixels are computed, and those of the other colour have a
/// relaxation of 0: that makes plain vector code. A pixel's neighbours are all of the other colour, so the order does
/// not matter. The result goes to another row than the one that is read, so that the compiler can vectorise the loop.
CORTSHIFT_VECTORISED
void relaxRow(const SweepRow& r, const float* relaxation, const float* u, const float* v, float* __restrict__ new_u,
              float* __restrict__ new_v, int width) {
  const float *ixx = r.ixx, *ixy = r.ixy, *iyy = r.iyy, *cu = r.cu, *cv = r.cv, *right = r.right, *below = r.below,
              *above = r.below_of_above, *ua = r.u_above, *ub = r.u_below, *va = r.v_above, *vb = r.v_below;
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) {
    const float fu = cu[x] + right[x] * u[x + 1] + right[x - 1] * u[x - 1] + below[x] * ub[x] + above[x] * ua[x];
    const float fv = cv[x] + right[x] * v[x + 1] + right[x - 1] * v[x - 1] + below[x] * vb[x] + above[x] * va[x];
    const float nu = ixx[x] * fu + ixy[x] * fv, nv = ixy[x] * fu + iyy[x] * fv;
    new_u[x] = u[x] + relaxation[x] * (nu - u[x]);
    new_v[x] = v[x] + relaxation[x] * (nv - v[x]);
  }
}

void assemble(const MotionTensor& tensor, const Plane& u0, const Plane& v0, const Plane& edge_weight,
              const RobustEnergy& energy, LinkedSystem& s, const Plane& u, const Plane& v, Plane& diffusivity,
              int threads) {
  const int width = u.width(), height = u.height();
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      diffusivityRow(u.row(y), u.row(y + 1), v.row(y), v.row(y + 1), edge_weight.empty() ? nullptr : edge_weight.row(y),
                     energy.epsilon_smooth, energy.alpha, diffusivity.row(y), width);
  });
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      linkRow(diffusivity.row(y), diffusivity.row(y + 1), s.right.row(y), s.below.row(y), width);
      s.right.row(y)[-1] = s.right.row(y)[width - 1] = 0;  // no flux through the image's edge
      if (y == height - 1) std::fill(s.below.row(y), s.below.row(y) + width, 0.f);
    }
  });
  forRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      assembleRow(
          {tensor.xx.row(y), tensor.xy.row(y), tensor.yy.row(y), tensor.xt.row(y), tensor.yt.row(y), tensor.tt.row(y),
           u0.row(y), v0.row(y), u.row(y), v.row(y), s.right.row(y), s.below.row(y), s.below.row(y - 1),
           s.inverse_xx.row(y), s.inverse_xy.row(y), s.inverse_yy.row(y), s.c_u.row(y), s.c_v.row(y)},
          energy.epsilon_data, width);
  });
}

}  // namespace

void minimise(const MotionTensor& tensor, const Plane& u0, const Plane& v0, const Plane& edge_weight,
              const RobustEnergy& energy, int fixed_points, int sweeps, LinkedSystem& system, Plane& u, Plane& v,
              int threads) {
  const int width = u.width(), height = u.height();
  system.create(u.size());
  Plane diffusivity;
  diffusivity.create(height, width);
  std::vector<float> relaxation(static_cast<std::size_t>(width + 1), 0.f);  // of every other pixel
  for (std::size_t x = 0; x < relaxation.size(); x += 2) relaxation[x] = kOverRelaxation;
  for (int k = 0; k < fixed_points; ++k) {
    u.replicateBorder();
    v.replicateBorder();
    assemble(tensor, u0, v0, edge_weight, energy, system, u, v, diffusivity, threads);
    for (int sweep = 0; sweep < 2 * sweeps; ++sweep)
      forRows(height, threads, [&](int begin, int end) {
        std::vector<float> row(2 * static_cast<std::size_t>(width));
        float *new_u = row.data(), *new_v = new_u + width;
        for (int y = begin; y < end; ++y) {
          relaxRow({system.inverse_xx.row(y), system.inverse_xy.row(y), system.inverse_yy.row(y), system.c_u.row(y),
                    system.c_v.row(y), system.right.row(y), system.below.row(y), system.below.row(y - 1), u.row(y - 1),
                    u.row(y + 1), v.row(y - 1), v.row(y + 1)},
                   relaxation.data() + ((y + sweep) & 1), u.row(y), v.row(y), new_u, new_v, width);
          std::copy_n(new_u, width, u.row(y));
          std::copy_n(new_v, width, v.row(y));
        }
      });
  }
}

}  // namespace cortshift_flow
