#include "sources/aravis/clock_map.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace cortshift_stereo {
namespace {

constexpr double kShortest = 5.0;    // [s] below this the slope would follow the jitter
constexpr double kMaxDrift = 0.001;  // no crystal is that bad
constexpr double kJump = 0.1;        // [s] beyond the jitter of a network
constexpr double kSameStep = 0.02;   // [s] a network that is slow is not so evenly
constexpr std::size_t kSteps = 5;    // images that must all be late by the same

}  // namespace

double ClockMap::add(Stamp device, Stamp arrival) {
  const auto sampleOf = [&] {
    const double time = toSeconds(device - device_origin_);
    return Sample{time, toSeconds(arrival - host_origin_) - time};
  };
  double jumped = 0;
  if (!samples_.empty()) {
    const Sample sample = sampleOf();
    const double above = sample.lag - (offset_ + drift_ * sample.time);
    if (above > kJump)
      late_.push_back(above);
    else
      late_.clear();
    if (late_.size() > kSteps) late_.pop_front();
    jumped = jump(sample);
    if (jumped != 0) {
      samples_.clear();
      late_.clear();
    }
  }
  if (samples_.empty()) {
    device_origin_ = device;
    host_origin_ = arrival;
  }
  samples_.push_back(sampleOf());
  if (samples_.size() > window_) samples_.pop_front();
  fit();
  return jumped;
}

double ClockMap::jump(const Sample& sample) const {
  const double above = sample.lag - (offset_ + drift_ * sample.time);
  const bool back = sample.time <= samples_.back().time;
  const bool before_its_exposure = above < -kJump;
  const bool all_late_by_the_same =
      late_.size() == kSteps &&
      *std::max_element(late_.begin(), late_.end()) - *std::min_element(late_.begin(), late_.end()) < kSameStep;
  return back || before_its_exposure || all_late_by_the_same ? -above : 0;
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
