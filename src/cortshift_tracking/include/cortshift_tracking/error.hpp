#pragma once

#include <stdexcept>

namespace cortshift_tracking {

/// Input that a step refuses. The message names what is wrong and what to do about it.
class TrackingError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace cortshift_tracking
