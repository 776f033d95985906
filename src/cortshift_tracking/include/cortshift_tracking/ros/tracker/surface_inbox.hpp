// The surfaces that have come in lately, for requests that wait for one.
#pragma once

#include <ros/time.h>
#include <sensor_msgs/PointCloud2.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <mutex>

namespace cortshift_tracking {

/// Thread-safe. Waiting is bounded in wall time: a simulated clock may stand still.
class SurfaceInbox {
 public:
  using Deadline = std::chrono::steady_clock::time_point;

  void put(const sensor_msgs::PointCloud2ConstPtr& surface);

  /// When the pair of this stamp came in. Where the two differ by more than a graph takes, the stamp is of another
  /// clock, and ages are told from this one.
  void noteReceived(const ros::Time& stamp, const ros::Time& received);

  /// How many have come in.
  unsigned long count() const;

  /// The surface of this stamp, or the first one after it: while a camera runs free, the reconstruction may pass over a
  /// pair for the next one. Null when the deadline passes.
  /// @param seen  count() before the pair was exposed: what had come in by then is older, whatever its stamp says after
  /// the clock was set back
  sensor_msgs::PointCloud2ConstPtr waitSince(const ros::Time& stamp, unsigned long seen, Deadline deadline) const;

  /// The newest surface if its stamp lies within `max_age` of the time of the call; otherwise the next one that comes
  /// in and is not older than that. With a clock that does not run yet (time 0) nothing that is already there counts.
  /// Null when the deadline passes.
  sensor_msgs::PointCloud2ConstPtr waitForRecent(const ros::Duration& max_age, Deadline deadline) const;

  /// The newest surface if more have come in than the `seen` that the caller knows of (0 at first); `seen` moves on, so
  /// that surfaces which came in meanwhile are passed over. Null after `patience`.
  sensor_msgs::PointCloud2ConstPtr waitForNewer(unsigned long& seen, std::chrono::milliseconds patience) const;

  /// Stamp of the newest surface; zero: none yet.
  ros::Time newestStamp() const;

 private:
  ros::Time exposed(const sensor_msgs::PointCloud2& surface) const;  // with the mutex held

  static constexpr std::size_t kKept = 4;
  mutable std::mutex mutex_;
  mutable std::condition_variable arrived_;
  std::deque<sensor_msgs::PointCloud2ConstPtr> surfaces_;  // in order of arrival
  std::map<ros::Time, ros::Time> received_;                // by stamp
  unsigned long count_ = 0;                                // of all that have come in
};

}  // namespace cortshift_tracking
