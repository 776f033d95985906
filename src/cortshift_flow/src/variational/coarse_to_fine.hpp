// The multiscale minimisation of Ji et al. 2014, Eq. (5), from the coarsest level of a pyramid to a chosen one.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "images/plane.hpp"
#include "variational/robust_solver.hpp"

namespace cortshift_flow {

/// One level of both images' pyramids; masks are empty where everything is valid.
struct Level {
  cv::Mat4f first, second;
  cv::Mat1b first_valid, second_valid;
};

struct LevelEffort {
  RobustEnergy energy;
  int warps = 3;         ///< outer iterations: linearisations of the data term
  int fixed_points = 1;  ///< inner iterations: updates of psi' and phi'
  int sweeps = 10;       ///< of the linear solver
};

struct FlowPlanes {
  Plane u, v;
};

/// The same flow on a grid of twice the density, in that grid's pixels.
FlowPlanes doubled(const FlowPlanes& coarse, cv::Size size, int threads);

/// Improves `flow` at one level.
void refine(const Level& level, const cv::Vec4f& channel_weights, const LevelEffort& effort, FlowPlanes& flow,
            int threads);

}  // namespace cortshift_flow
