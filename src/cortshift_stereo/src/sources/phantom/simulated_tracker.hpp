// An infrared tracker's way of reporting poses: noisy, and now and then not at all.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <random>

#include "cortshift_stereo/sources/stereo_source.hpp"

namespace cortshift_stereo {

struct TrackerSettings {
  double rate = 20;             ///< samples per second
  double latency = 0;           ///< a sample is reported this long after it was taken [s]
  double jitter = 0;            ///< standard deviation of each coordinate [m]
  double jitter_angle = 0;      ///< standard deviation about each axis [rad]
  double dropouts = 0;          ///< mean number of dropouts per second
  double dropout_length = 0.2;  ///< [s]
  int seed = 1;
};

/// Repeatable: the same seed and sequence of calls give the same samples.
class SimulatedTracker {
 public:
  explicit SimulatedTracker(const TrackerSettings& settings);

  /// Whether the tools are seen at `time`. Times must not decrease.
  bool sees(Stamp time);

  /// The pose as measured. `more_jitter`: of each coordinate, besides that of the settings [m].
  Eigen::Isometry3d measure(const Eigen::Isometry3d& truth, double more_jitter = 0);

 private:
  TrackerSettings settings_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  std::optional<Stamp> next_dropout_;
};

}  // namespace cortshift_stereo
