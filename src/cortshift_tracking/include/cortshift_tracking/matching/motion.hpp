// How fast and how steadily a tracked camera moved around an exposure.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace cortshift_tracking {

struct PoseSample {
  double time;                     ///< [s], from any origin
  Eigen::Isometry3d T_map_camera;  ///< optical frame: z into the scene [m]
};

struct Motion {
  double speed;   ///< of what the camera looks at, or of the camera itself where that is faster [m/s]
  double jitter;  ///< root mean square distance from the uniform motion, of the point that has more of it [m]
};

/// Least-squares uniform motion of the camera's origin and of the point `working_distance` in front of it, which a
/// rotation moves. Times all equal or fewer than three samples: nothing.
std::optional<Motion> motionOf(const std::vector<PoseSample>& samples, double working_distance);

}  // namespace cortshift_tracking
