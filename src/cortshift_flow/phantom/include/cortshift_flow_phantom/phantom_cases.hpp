// The named cases that tests and the benchmark share.
#pragma once

#include <string>
#include <vector>

#include "cortshift_flow_phantom/planar_phantom.hpp"

namespace cortshift_flow_phantom {

/// Names of all cases, e.g. "outward", "noise5", "smooth600".
std::vector<std::string> phantomCaseNames();

/// @throws std::invalid_argument for a name that is not one of phantomCaseNames().
PlanarPhantomSettings phantomCase(const std::string& name, std::uint32_t seed = 1);

}  // namespace cortshift_flow_phantom
