// What is left of an image without its slow variations; neither offset nor vignetting changes it much.
#pragma once

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// Both images less their low-pass of a few pixels, of which the share `kept` stays.
Level highPass(const Level& level, float kept = 0);

}  // namespace cortshift_flow
