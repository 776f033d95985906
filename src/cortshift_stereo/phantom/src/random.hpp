// Repeatable random numbers, the same on every machine.
#pragma once

#include <cstdint>

namespace cortshift_stereo_phantom {

inline std::uint64_t mixBits(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// SplitMix64.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(mixBits(seed + 0x9e3779b97f4a7c15ULL)) {}
  std::uint64_t bits() { return mixBits(state_ += 0x9e3779b97f4a7c15ULL); }
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1.0p-53; }  ///< [0, 1)

 private:
  std::uint64_t state_;
};

}  // namespace cortshift_stereo_phantom
