// Two displacements one after the other.
#pragma once

#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking {

/// The displacement by `first` and then on by `second`, over the grid of `first`: it starts where `first` starts and
/// ends where `second` brings the point that `first` leads to. `second` starts on the surface that `first` ends on.
/// NaN where one of them says nothing, and where the end of `first` is more than a millimetre off that surface. The
/// confidence is the product of both; there is no strain.
DisplacementField composed(const DisplacementField& first, const DisplacementField& second);

}  // namespace cortshift_tracking
