// The default method: a robust start, the paper's energy at coarse levels, and a second-order polish.
#pragma once

#include "cortshift_flow/flow.hpp"
#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

struct Estimate {
  FlowPlanes flow;
  cv::Mat1f confidence;
};

Estimate estimateFlow(const Level& images, const FlowSettings& settings, int threads);

}  // namespace cortshift_flow
