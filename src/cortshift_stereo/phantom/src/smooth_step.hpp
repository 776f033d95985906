// The quintic step: 0 below 0, 1 above 1, twice continuously differentiable.
#pragma once

#include <algorithm>

namespace cortshift_stereo_phantom {

inline double smoothStep(double t) {
  t = std::clamp(t, 0.0, 1.0);
  return t * t * t * (t * (6 * t - 15) + 10);
}

inline double smoothStepSlope(double t) {
  t = std::clamp(t, 0.0, 1.0);
  return 30 * t * t * (t - 1) * (t - 1);
}

}  // namespace cortshift_stereo_phantom
