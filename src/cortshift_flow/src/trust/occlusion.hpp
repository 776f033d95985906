// What the first image shows and the second does not, and how its flow is continued.
#pragma once

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// 1 where some pixel of the second image flows back to (CV_8UC1). What no pixel comes from has been covered, or has
/// left the image.
/// @param trusted  0 where the backward flow does not count, or empty
cv::Mat1b coveredBy(const FlowPlanes& backward, const cv::Mat1b& trusted = {});

/// 1 where following `flow` and then `opposite` leads back to within `tolerance` [px]. Two independent estimates then
/// agree: if the window still mismatches, its flow is inaccurate or its brightness has changed, but it is not hidden.
cv::Mat1b consistent(const FlowPlanes& flow, const FlowPlanes& opposite, float tolerance, int threads);

/// Replaces the flow where `visible` is 0 by a linear continuation of the visible flow on one side. At a boundary
/// between two motions the hidden strip belongs to one of the two sides. The motion does not show which, so the side of
/// the same colour is taken, and if the colours do not differ the side that moves more: tissue slides under the edge
/// of a craniotomy, a retractor or a pad, which rest.
enum class Continue {
  kByColour,  ///< as said above
  kResting,   ///< from the side that moves less, whatever its colour: what lies behind
};
void continueFlow(const cv::Mat4f& image, const cv::Mat1b& visible, Continue side, FlowPlanes& flow, int threads);

}  // namespace cortshift_flow
