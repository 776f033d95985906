#include "cortshift_tracking/matching/motion.hpp"

#include <algorithm>
#include <cmath>

namespace cortshift_tracking {

std::optional<Motion> motionOf(const std::vector<PoseSample>& samples, double working_distance) {
  if (samples.size() < 3) return std::nullopt;
  const auto count = static_cast<double>(samples.size());
  double mean_time = 0, spread = 0;
  for (const PoseSample& sample : samples) mean_time += sample.time / count;
  for (const PoseSample& sample : samples) spread += (sample.time - mean_time) * (sample.time - mean_time);
  if (!(spread > 0)) return std::nullopt;
  Motion motion{0, 0};
  for (const double depth : {0.0, working_distance}) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero(), velocity = Eigen::Vector3d::Zero();
    const auto point = [&](const PoseSample& sample) -> Eigen::Vector3d {
      return sample.T_map_camera * Eigen::Vector3d(0, 0, depth);
    };
    for (const PoseSample& sample : samples) mean += point(sample) / count;
    for (const PoseSample& sample : samples) velocity += (sample.time - mean_time) / spread * (point(sample) - mean);
    double squares = 0;
    for (const PoseSample& sample : samples)
      squares += (point(sample) - mean - velocity * (sample.time - mean_time)).squaredNorm();
    motion.speed = std::max(motion.speed, velocity.norm());
    motion.jitter = std::max(motion.jitter, std::sqrt(squares / count));
  }
  return motion;
}

}  // namespace cortshift_tracking
