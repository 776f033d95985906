// Scenes with many motion boundaries (instruments, retractors, a photograph of objects at different depths): one smooth
// surface does not describe their flow, so Eq. (5), whose flow is piecewise smooth, is minimised at full resolution.
#pragma once

#include <vector>

#include "cortshift_flow/flow.hpp"
#include "start/rough_flow.hpp"
#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

struct PiecewiseFlow {
  FlowBothWays flow;
  cv::Mat1b agree;  ///< 1 where both ways agree
  cv::Mat1f error;  ///< predicted [px]
};

/// Minimises Eq. (5) on high-passed images at every level, both ways, with a median filter after each linearisation;
/// where the two directions disagree the flow is continued from the side that moves less (what lies behind).
/// @param finest  level at which to stop
PiecewiseFlow piecewiseFlow(const std::vector<Level>& levels, int start, int finest, const FlowSettings& settings,
                            int threads);

}  // namespace cortshift_flow
