// Sub-pixel polish: the flow as a cubic B-spline surface with a second-order (Hessian) smoothness term.
//
// The first-order term of Ji et al. 2014, Eq. (4), favours flow that is constant; tissue that stretches is not, and
// weighting Eq. (4) up to average out noise bends its flow. A penalty on the flow's second derivatives leaves every
// affine motion free, so it may average over a wide neighbourhood.
#pragma once

#include <opencv2/core.hpp>

#include "variational/coarse_to_fine.hpp"
#include "variational/data_term.hpp"

namespace cortshift_flow {

struct PolishEffort {
  int linearisations = 3;        ///< Gauss-Newton steps
  int stiff_linearisations = 0;  ///< of these, steps before the expected curvature may follow the flow's own
  int solver_iterations = 30;    ///< conjugate gradients per step
  float curvature = 0.012f;      ///< expected second difference of the flow between neighbouring nodes [px]
  float break_at = 1.0f;         ///< a second difference beyond this is a motion boundary, not curvature [px]
};

/// A flow on the nodes of a SplineGrid, and how well it is known there.
struct PolishedFlow {
  FlowPlanes nodes;   ///< spline coefficients [px]
  Plane information;  ///< smaller eigenvalue of the data's information about the flow at each node [1 / px^2]
  cv::Mat1b regular;  ///< per cell between pixels (4i, 4j) and (4i + 3, 4j + 3): 1 where no boundary passes
};

/// @param channel_weights  inverse noise variance of each channel's difference [1 / intensity^2]
/// @param visible  0 where a pixel of the first image has no match (CV_8UC1, size of the image), or empty
/// @param start  flow at every pixel, right to about half a pixel
PolishedFlow polish(const ImagePair& images, const cv::Vec4f& channel_weights, const cv::Mat1b& visible,
                    const FlowPlanes& start, const PolishEffort& effort, int threads);

/// The flow at every pixel: the surface in regular cells, `otherwise` at motion boundaries.
FlowPlanes evaluate(const PolishedFlow& polished, const FlowPlanes& otherwise, int threads);

/// The surface at the pixels of one row.
void evaluateRow(const PolishedFlow& flow, int y, float* scratch, float* u, float* v, int width);

}  // namespace cortshift_flow
