// Notices a node that waits for a simulated clock which nobody drives.
#pragma once

#include <ros/time.h>

#include <mutex>
#include <string>

namespace cortshift_stereo {

/// A replay sets /use_sim_time on the master, and leaves it there. A live node started later then has no time at all.
/// Thread-safe.
class ClockWatch {
 public:
  /// What is wrong and what to do; empty: nothing. Ask now and then.
  std::string trouble();

 private:
  std::mutex mutex_;
  ros::Time last_;
  ros::WallTime advanced_;
};

}  // namespace cortshift_stereo
