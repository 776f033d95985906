// What a flow is worth beside its own steps.
#pragma once

#include <opencv2/core.hpp>

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// Error (root mean square) at each pixel of a level from the place of a step of the flow, which is known to a few
/// pixels only: a vector nearby is that of the one side or of the other [px of the level]. A steady slope is no step.
cv::Mat1f errorBesideSteps(const FlowPlanes& flow);

}  // namespace cortshift_flow
