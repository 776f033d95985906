// Whether anybody waits for a surface.
#pragma once

#include <chrono>

namespace cortshift_stereo {

/// Each pair is worked on until somebody says that he is ready for a surface, and from then on one for each such word:
/// a surface that comes while he still computes with the one before would be computed for nothing, and takes the time
/// that he needs. Who falls silent is forgotten.
class SurfaceDemand {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::chrono::seconds kPatience{1};

  /// Somebody is ready for the next one.
  void want(Time now) {
    wanted_ = true;
    known_until_ = now + kPatience;
  }

  /// One has been published.
  void served() { wanted_ = false; }

  bool waits(Time now) const { return wanted_ || now >= known_until_; }

 private:
  bool wanted_ = false;
  Time known_until_{};
};

}  // namespace cortshift_stereo
