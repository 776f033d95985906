// The default method: a robust start, the paper's energy at coarse levels, and a second-order polish.
#pragma once

#include <vector>

#include "cortshift_flow/flow.hpp"
#include "trust/judgement.hpp"
#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

struct Estimate {
  FlowPlanes flow;
  cv::Mat1f confidence;
};

/// A flow of one of the models and the evidence about it (see trust/evidence.hpp).
struct Told {
  FitKind kind;
  FlowPlanes flow;
  cv::Mat evidence;
};

/// @param told  where not null, gets what is known of each flow that was fitted: for the program that fits the
///              weights of the evidence
Estimate estimateFlow(const Level& images, const FlowSettings& settings, int threads,
                      std::vector<Told>* told = nullptr);

}  // namespace cortshift_flow
