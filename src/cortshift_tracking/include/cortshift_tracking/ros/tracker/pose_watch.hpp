// Whether the camera stood still and its pose was fresh, before a stage is made of what it saw.
#pragma once

#include <atomic>
#include <optional>
#include <string>

#include "cortshift_stereo/ros/pose_lookup.hpp"
#include "cortshift_stereo/ros/pose_tree.hpp"
#include "cortshift_tracking/matching/motion.hpp"

namespace cortshift_tracking {

/// Motion of left_optical in pmr around an exposure; nothing where the pose at the stamp itself is not known.
/// @throws TrackingError where the pose is known at the stamp but too seldom around it to tell
std::optional<Motion> motionAround(const ros::Time& stamp, const cortshift_stereo::PoseAt& pose_at);

/// @param max_speed  [m/s]
/// @throws TrackingError if the camera moved faster
void requireSlow(const Motion& motion, double max_speed);

/// Asks tf for left_optical in pmr. Thread-safe.
class PoseWatch {
 public:
  /// @param max_speed  [m/s]
  PoseWatch(cortshift_stereo::PoseLookup& poses, double max_speed) : poses_(poses), max_speed_(max_speed) {}

  /// See motionAround.
  std::optional<Motion> motionAt(const ros::Time& stamp) const;

  /// @throws TrackingError if the camera moved faster than max_speed, or if its pose, known before, was not known then
  void requireStill(const ros::Time& stamp) const;

  /// Age of the newest known pose [s]; nothing where none is known for the last seconds.
  /// @param contradiction  gets why there is none where two sources say different poses; may be null
  std::optional<double> age(std::string* contradiction = nullptr) const;

  /// @throws TrackingError if there was a pose once and the tracker has now lost the tool for a while, or if two
  /// sources
  ///   say different poses
  void requireSeen() const;

 private:
  cortshift_stereo::PoseLookup& poses_;
  const double max_speed_;
  mutable std::atomic<bool> ever_{false};  // a pose was known at some time
};

}  // namespace cortshift_tracking
