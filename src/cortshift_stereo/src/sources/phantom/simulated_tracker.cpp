#include "sources/phantom/simulated_tracker.hpp"

#include <cmath>

namespace cortshift_stereo {

SimulatedTracker::SimulatedTracker(const TrackerSettings& settings)
    : settings_(settings), random_(static_cast<std::uint64_t>(settings.seed)) {}

bool SimulatedTracker::sees(Stamp time) {
  if (settings_.dropouts <= 0) return true;
  std::exponential_distribution<double> until_next(settings_.dropouts);
  const Stamp length = fromSeconds(settings_.dropout_length);
  if (!next_dropout_) next_dropout_ = time + fromSeconds(until_next(random_));
  while (*next_dropout_ + length <= time) *next_dropout_ += length + fromSeconds(until_next(random_));
  return time < *next_dropout_;
}

Eigen::Isometry3d SimulatedTracker::measure(const Eigen::Isometry3d& truth, double more_jitter) {
  const auto deviate = [&](double sigma) -> Eigen::Vector3d {
    Eigen::Vector3d deviation;
    for (double& value : deviation) value = sigma * normal_(random_);
    return deviation;
  };
  const double jitter = std::hypot(settings_.jitter, more_jitter);
  if (jitter <= 0 && settings_.jitter_angle <= 0) return truth;
  Eigen::Isometry3d pose = truth;
  pose.translation() += deviate(jitter);
  const Eigen::Vector3d turn = deviate(settings_.jitter_angle);
  if (turn.norm() > 0) pose.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()) * truth.linear();
  return pose;
}

}  // namespace cortshift_stereo
