// The start: a flow right to about half a pixel, both ways, that no brightness change and no large motion misleads.
#pragma once

#include <vector>

#include "cortshift_flow/flow.hpp"
#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

struct FlowBothWays {
  FlowPlanes forward, backward;
};

/// Both images' levels down to the one at which whole-pixel matches are searched.
std::vector<Level> searchPyramid(const Level& images, int threads);

/// With which Eq. (5) is minimised at each level.
LevelEffort roughEffort(const FlowSettings& settings);

/// Search, then Eq. (5) from coarse to fine on high-passed images, which brightness changes leave alone.
/// @param finest  level at which to stop
FlowBothWays roughFlow(const std::vector<Level>& levels, int finest, const FlowSettings& settings, int threads);

/// Over which flow is exchanged between pixels [px of the level].
const std::vector<int>& exchangeReaches();

}  // namespace cortshift_flow
