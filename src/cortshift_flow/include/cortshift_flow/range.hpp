#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace cortshift_flow {

/// Every setting of every package is checked and refused in these words.
/// @throws Error naming the setting, its value and what is allowed, also for NaN
template <typename Error = std::invalid_argument, typename Number>
void requireRange(const std::string& name, Number value, Number low, Number high) {
  if (value >= low && value <= high) return;
  std::ostringstream text;
  text << name << " = " << value << " is not allowed; allowed is " << low << " ... " << high;
  throw Error(text.str());
}

}  // namespace cortshift_flow
