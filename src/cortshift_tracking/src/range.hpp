#pragma once

#include <sstream>
#include <string>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

template <typename Number>
void requireRange(const char* key, Number value, Number low, Number high) {
  if (value >= low && value <= high) return;
  std::ostringstream out;
  out << key << " = " << value << " is not allowed; allowed is " << low << " ... " << high;
  throw TrackingError(out.str());
}

}  // namespace cortshift_tracking
