// What the product makes of a pair of the stereo phantom.
#pragma once

#include "cortshift_stereo/geometry/surface.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace cortshift_tracking_phantom {

/// Surface of the left camera in pmr, reconstructed from the first pair of a stage and placed by the exact pose.
cortshift_stereo::Surface seenSurface(cortshift_stereo_phantom::PhantomPairs& pairs, int stage);

}  // namespace cortshift_tracking_phantom
