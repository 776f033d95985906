// The camera's clock against ours.
#pragma once

#include <cstdint>
#include <deque>

#include "cortshift_stereo/sources/stereo_source.hpp"

namespace cortshift_stereo {

/// Maps device time stamps to host time. An image arrives some varying time after its stamp, but never before it: the
/// line offset + drift * t that lies under all (stamp, arrival - stamp) and closest to them is that of the fastest
/// transfers, free of the jitter of all others. A camera's clock that is set (a reset, another PTP master) shows as
/// stamps that go back, as images that come before their exposure, or as several that are all late by the same. It is
/// the edge of the lower convex hull above the samples' mean time.
class ClockMap {
 public:
  explicit ClockMap(std::size_t window = 600) : window_(window) {}

  /// @param device   stamp by the camera's clock
  /// @param arrival  when the image was there, host time
  /// @returns by how much the camera's clock has jumped [s]; then the map has begun anew. 0: it has not
  double add(Stamp device, Stamp arrival);

  /// Host time of a device stamp, late by the time of the fastest transfer. Only after add().
  Stamp toHost(Stamp device) const;

  double drift() const { return drift_; }  ///< of the host's clock against the device's [s/s]
  std::size_t samples() const { return samples_.size(); }

 private:
  struct Sample {
    double time, lag;  ///< [s], both against the first sample so that no digits are lost
  };

  void fit();
  double jump(const Sample& sample) const;

  std::size_t window_;
  std::deque<Sample> samples_;
  std::deque<double> late_;  // how far the newest lie above the line [s], while they lie far above it
  Stamp device_origin_{}, host_origin_{};
  double offset_ = 0, drift_ = 0;
};

}  // namespace cortshift_stereo
