#pragma once

#include <std_msgs/Header.h>
#include <visualization_msgs/MarkerArray.h>

#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking {

/// Arrows from the earlier to the later surface, one every `spacing` [m] of the grid, coloured by magnitude on the
/// scale of magnitudeMap. The first marker clears those of the field before.
visualization_msgs::MarkerArray arrowsOf(const DisplacementField& field, const std_msgs::Header& header,
                                         double spacing);

}  // namespace cortshift_tracking
