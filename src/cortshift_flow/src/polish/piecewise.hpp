// Scenes of many motion boundaries (instruments, retractors, a photograph of objects in depth): there one smooth
// surface is no model of the flow, and Eq. (5) with its piecewise smooth one is taken to full resolution.
#pragma once

#include <vector>

#include "cortshift_flow/flow.hpp"
#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

struct PiecewiseFlow {
  FlowPlanes flow;
  cv::Mat1f error;  ///< predicted [px]
};

/// Minimises Eq. (5) on high-passed images at every level, both ways, with a median filter after each linearisation;
/// what does not agree both ways is continued from the side that moves less (what lies behind).
/// @param finest  level at which to stop
PiecewiseFlow piecewiseFlow(const std::vector<Level>& levels, int start, int finest, const FlowSettings& settings,
                            int threads);

}  // namespace cortshift_flow
