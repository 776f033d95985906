// The linear system of the polish: data and stiffness of a grid of nodes.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "polish/polish.hpp"

namespace cortshift_flow {

/// Weights of the second differences about each node: along x, along y, and mixed (with the nodes right and below).
struct Stencils {
  Plane xx, yy, xy;
};

/// Data term per node: information matrix and right-hand side of the normal equations.
struct NodeData {
  Plane xx, xy, yy, u, v;
};

/// Conjugate gradients on (data + second-order smoothness) nodes = right-hand side.
class NodeSolver {
 public:
  NodeSolver(cv::Size size, int threads);

  Stencils stencils;
  NodeData data;

  void solve(int iterations, FlowPlanes& x);

 private:
  template <typename Body>
  void rows(const Body& body) {
    forRows(size_.height, threads_, [&](int begin, int end) {
      for (int y = begin; y < end; ++y) body(y);
    });
  }

  double total() const;
  /// Weighted second differences of both components.
  void differences(const Plane& u, const Plane& v);
  /// Row y of the system's product with (u, v), whose differences have been taken.
  void applyRow(const Plane& u, const Plane& v, int y);
  double preconditionAndDot(int y);
  void prepareDiagonal();

  cv::Size size_;
  int threads_;
  std::vector<double> row_sums_;
  Stencils q_u_, q_v_;  // weighted second differences
  Plane inverse_xx_, inverse_xy_, inverse_yy_;
  FlowPlanes residual_, direction_, product_, preconditioned_;
};

}  // namespace cortshift_flow
