// Does the sum of consecutive displacements agree with the direct one (Ji et al. 2014, Table 3 and Discussion)?
#pragma once

#include <cstddef>
#include <vector>

#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking {

/// Distances [m] between the end points of the chain and of the direct field; NaN where no point has both.
struct Closure {
  std::size_t points = 0;
  double median = 0;
  double p95 = 0;
};

/// Follows every start point of `direct` through the consecutive fields (linear between their grid points).
/// @param consecutive 1 -> 2, 2 -> 3, ...; each on its own grid
/// @param direct 1 -> last
Closure closureOf(const std::vector<DisplacementField>& consecutive, const DisplacementField& direct);

}  // namespace cortshift_tracking
