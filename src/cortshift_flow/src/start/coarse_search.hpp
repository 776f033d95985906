// A first flow by exhaustive matching at a coarse level: it finds large motions that coarse-to-fine minimisation of
// Eq. (5) loses: a flow that starts too far away at a coarse level converges to a wrong minimum and stays there.
#pragma once

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

struct SearchResult {
  FlowPlanes forward, backward;
};

/// Best whole-pixel match of a window about every pixel by normalised correlation of the high-passed images, which
/// neither gain nor offset changes; matches that do not agree forward and backward are replaced by a smooth
/// continuation of those that do.
/// @param radius  largest displacement along each axis [px of the level]
SearchResult searchCoarseFlow(const Level& level, int radius, int threads);

}  // namespace cortshift_flow
