// Planes given by a coarse grid of cubic B-spline coefficients.
#pragma once

#include <array>

#include "images/plane.hpp"

namespace cortshift_flow {

/// Node (i, j) of the grid lies on pixel (kSpacing (i - 1), kSpacing (j - 1)): one node outside the image on the left
/// and two on the right carry the spline to the image's edge.
struct SplineGrid {
  static constexpr int kSpacing = 4;

  static cv::Size nodes(cv::Size pixels) {
    return {(pixels.width - 1) / kSpacing + 4, (pixels.height - 1) / kSpacing + 4};
  }

  /// weights[p][k]: of node j + k for pixel kSpacing j + p.
  using Weights = std::array<std::array<float, 4>, kSpacing>;
  static const Weights& weights();
};

/// Values of the spline on row y of the image; `scratch` holds as many floats as the grid has columns.
void evaluateSplineRow(const Plane& nodes, int y, float* scratch, float* out, int width);

/// The transpose of the evaluation along a row: sums a row's pixels, weighted, into each column of nodes.
void reduceRow(const float* pixels, int width, float* nodes, int node_columns);

/// The transpose along columns: node row j from all rows that reduceRow() made.
void reduceColumn(const Plane& reduced, int j, float* out);

}  // namespace cortshift_flow
