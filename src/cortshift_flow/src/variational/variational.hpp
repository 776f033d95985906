// The paper's model as printed: Ji et al. 2014, section 2.4.
#pragma once

#include "cortshift_flow/flow.hpp"
#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// Minimises Eq. (5) coarse to fine from zero flow.
FlowPlanes minimiseCoarseToFine(const Level& images, const FlowSettings& settings, int threads);

}  // namespace cortshift_flow
