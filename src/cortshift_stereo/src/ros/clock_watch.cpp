#include "cortshift_stereo/ros/clock_watch.hpp"

#include "cortshift_stereo/admission/verdict.hpp"

namespace cortshift_stereo {
namespace {

const ros::WallDuration kStanding(3.0);  // rosbag play --clock ticks a hundred times a second

}  // namespace

std::string ClockWatch::trouble() {
  if (!ros::Time::isSimTime()) return "";
  const std::lock_guard<std::mutex> lock(mutex_);
  const ros::Time now = ros::Time::now();
  const ros::WallTime wall = ros::WallTime::now();
  if (advanced_.isZero() || now != last_) {
    last_ = now;
    advanced_ = wall;
  }
  if (wall - advanced_ < kStanding) return "";
  return Finding{
      CheckId::kSimTime, Verdict::kWarn, "The clock",
      "stands still: /use_sim_time is set on this master, but nothing drives /clock",
      "a replay that is over or paused left it behind; before live use run `rosparam set /use_sim_time false` "
      "and start the nodes again"}
      .sentence();
}

}  // namespace cortshift_stereo
