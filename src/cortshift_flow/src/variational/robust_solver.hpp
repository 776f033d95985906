// The minimiser of Ji et al. 2014, Eq. (5): iteratively reweighted least squares with successive over-relaxation
// (Brox et al. 2004, section 3.2: the inner fixed points).
#pragma once

#include "images/plane.hpp"
#include "variational/data_term.hpp"

namespace cortshift_flow {

struct RobustEnergy {
  float alpha = 0.02f;           ///< weight of the smoothness term, Eq. (5)
  float epsilon_data = 1e-3f;    ///< of psi in Eq. (3)
  float epsilon_smooth = 1e-3f;  ///< of phi in Eq. (4)
};

/// Linear system of one fixed point, per pixel:
///   (D + sum w) (u, v)' = c + sum over the four neighbours of w (u_n, v_n)'.
/// `inverse_*` is the inverse of the 2 x 2 matrix on the left; right(x) links x to x + 1, below(y) y to y + 1.
struct LinkedSystem {
  Plane inverse_xx, inverse_xy, inverse_yy, c_u, c_v, right, below;
  void create(cv::Size size) {
    for (Plane* plane : {&inverse_xx, &inverse_xy, &inverse_yy, &c_u, &c_v, &right, &below})
      if (plane->size() != size) plane->create(size.height, size.width);
  }
};

/// Moves (u, v) towards the minimum of Eq. (5) with the data term linearised about (u0, v0).
/// @param edge_weight  factor on the smoothness at each pixel (small where flow may jump), or empty
void minimise(const MotionTensor& tensor, const Plane& u0, const Plane& v0, const Plane& edge_weight,
              const RobustEnergy& energy, int fixed_points, int sweeps, LinkedSystem& system, Plane& u, Plane& v,
              int threads);

}  // namespace cortshift_flow
