#pragma once
#include "trust/evidence.hpp"
namespace cortshift_flow {
struct CueWeights {
  float slope, knots[2], bends[2];
};
struct FittedWeights {
  float constant;
  CueWeights cues[kCues];
};
constexpr FittedWeights kFittedWeights[3] = {{1, {}}, {1, {}}, {1, {}}};
}  // namespace cortshift_flow
