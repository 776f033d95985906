// Arithmetic with ros::Time that cannot throw: a simulated clock starts at 0, and ros::Time has no negative values.
#pragma once

#include <ros/time.h>

namespace cortshift_stereo {

/// `time` by so many seconds later or, with negative ones, earlier; never before 0 nor after ros::TIME_MAX.
inline ros::Time shifted(const ros::Time& time, double seconds) {
  const double sum = time.toSec() + seconds;
  if (sum <= 0) return ros::Time();
  if (!(sum < ros::TIME_MAX.toSec())) return ros::TIME_MAX;
  return time + ros::Duration(seconds);
}

}  // namespace cortshift_stereo
