// tf at an exact stamp: waits for the tracker's next sample, interpolates, or says what is missing.
#pragma once

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <tf2_msgs/TFMessage.h>

#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "cortshift_stereo/geometry/transform_tree.hpp"
#include "cortshift_stereo/ros/pose_source.hpp"

namespace cortshift_stereo {

/// Listens to /tf and /tf_static on a thread of its own.
///
/// A clock that jumps back (a bag that starts again) makes it forget all samples. Frames may be spelt with or without
/// a leading slash. Thread-safe.
class PoseLookup {
 public:
  /// @param max_pose_gap  [s] farthest tracker sample on either side of a stamp
  /// @param history       [s] how long samples are kept
  explicit PoseLookup(double max_pose_gap, double history = 60.0);
  ~PoseLookup();

  PoseLookup(const PoseLookup&) = delete;
  PoseLookup& operator=(const PoseLookup&) = delete;

  /// T_target_source at `stamp`. Waits up to `wall_timeout` (also under a stopped simulated clock) for samples that
  /// may still be under way; a reason that cannot heal is thrown at once.
  /// @throws PoseError naming the edge or frame and the reason
  Eigen::Isometry3d lookup(const std::string& target, const std::string& source, const ros::Time& stamp,
                           ros::WallDuration wall_timeout);

  /// What the samples that have come by now say of that pose. @throws PoseError
  Findings judge(const std::string& target, const std::string& source, const ros::Time& stamp,
                 const PoseLimits& limits);

  /// A tracker whose clock is ahead: its samples would stand for a time that they were not measured at.
  /// @param lag  [s] from the stamp of the pair until it came in: where both are ahead alike, one clock stamps both
  Findings judgeClock(const std::string& target, const std::string& source, const ros::Time& stamp, double lag);

  /// Lookups with this patience, and what the samples that have come by then say. It refers to this object.
  PoseSource source(ros::WallDuration wall_timeout, const PoseLimits& limits);

 private:
  void add(const tf2_msgs::TFMessage& message, bool fixed);
  void noticeClock();  // with the mutex held

  std::mutex mutex_;
  std::condition_variable arrived_;
  TransformTree tree_;
  ros::Time last_now_;
  std::map<std::string, std::deque<double>> lags_;  // [s] of the newest samples of each moving edge, by its child

  ros::CallbackQueue queue_;
  ros::NodeHandle node_;
  ros::Subscriber moving_;
  ros::Subscriber fixed_;
  std::unique_ptr<ros::AsyncSpinner> spinner_;
};

}  // namespace cortshift_stereo
