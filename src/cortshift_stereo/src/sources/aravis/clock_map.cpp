#include "sources/aravis/clock_map.hpp"

#include <cmath>
#include <vector>

namespace cortshift_stereo {
namespace {

constexpr double kShortest = 5.0;    // [s] below this the slope would follow the jitter
constexpr double kMaxDrift = 0.001;  // no crystal is that bad

}  // namespace

void ClockMap::add(Stamp device, Stamp arrival) {
  if (samples_.empty()) {
    device_origin_ = device;
    host_origin_ = arrival;
  }
  const double time = toSeconds(device - device_origin_);
  samples_.push_back({time, toSeconds(arrival - host_origin_) - time});
  if (samples_.size() > window_) samples_.pop_front();
  fit();
}

void ClockMap::fit() {
  std::vector<Sample> hull;
  double mean = 0;
  for (const Sample& sample : samples_) {
    mean += sample.time / static_cast<double>(samples_.size());
    const auto above = [&](const Sample& a, const Sample& b) {
      return (b.lag - a.lag) * (sample.time - a.time) >= (sample.lag - a.lag) * (b.time - a.time);
    };
    while (hull.size() >= 2 && above(hull[hull.size() - 2], hull.back())) hull.pop_back();
    hull.push_back(sample);
  }
  if (samples_.back().time - samples_.front().time >= kShortest)
    for (std::size_t i = 1; i < hull.size(); ++i) {
      if (hull[i].time < mean) continue;
      const double slope = (hull[i].lag - hull[i - 1].lag) / (hull[i].time - hull[i - 1].time);
      if (std::abs(slope) <= kMaxDrift) {
        drift_ = slope;
        offset_ = hull[i].lag - slope * hull[i].time;
        return;
      }
      break;
    }
  drift_ = 0;
  offset_ = samples_.front().lag;
  for (const Sample& sample : samples_) offset_ = std::min(offset_, sample.lag);
}

Stamp ClockMap::toHost(Stamp device) const {
  const double time = toSeconds(device - device_origin_);
  return host_origin_ + fromSeconds(time + offset_ + drift_ * time);
}

}  // namespace cortshift_stereo
