#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace cortshift_flow {

/// Everywhere an expected error e is told as a confidence 1 / (1 + (e / h)^2), h being the error at which it is one
/// half.
/// @param squares  (e / h)^2
inline float confidenceOfSquares(float squares) { return 1 / (1 + squares); }

/// The expected error that a confidence stands for, in the unit of `half`; infinite for 0 and below.
inline double errorOfConfidence(double confidence, double half) {
  return confidence > 0 ? half * std::sqrt(std::max(0.0, 1 / confidence - 1)) : std::numeric_limits<double>::infinity();
}

}  // namespace cortshift_flow
