// Whether anybody waits for a surface.
#pragma once

#include <ros/time.h>

#include <chrono>

namespace cortshift_stereo {

/// Each pair is worked on until somebody says which surface he has taken and that he is ready for the next. From then
/// on the next one is made when the last has been taken: one that comes while he still computes would be old when he
/// takes it, and costs the time that he needs. Who falls silent is forgotten.
class SurfaceDemand {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// More than a field takes, with a shift that somebody asked for in between (BENCHMARK.md).
  static constexpr std::chrono::seconds kPatience{3};

  /// Somebody is ready for the next one.
  /// @param taken  stamp of the one that he had last; zero: none
  void want(Time now, const ros::Time& taken) {
    // Who says so again has not received what was published since. Otherwise it is still on its way to him.
    wanted_ = taken.isZero() || taken == published_ || taken == taken_;
    taken_ = taken;
    known_until_ = now + kPatience;
  }

  /// The one of this stamp is about to be published.
  void served(const ros::Time& stamp) {
    wanted_ = false;
    published_ = stamp;
  }

  bool waits(Time now) const { return wanted_ || now >= known_until_; }

 private:
  bool wanted_ = false;
  ros::Time published_, taken_;
  Time known_until_{};
};

}  // namespace cortshift_stereo
