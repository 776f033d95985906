#include "cortshift_tracking/ros/tracker/pose_watch.hpp"

#include <cstdio>
#include <string>

#include "cortshift_stereo/ros/shifted_time.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kHalfWindow = 0.25;      // [s] on either side of an exposure
constexpr double kStep = 0.05;            // [s] about a tracker's period
constexpr std::size_t kFewest = 4;        // instants that make a motion
constexpr double kWorkingDistance = 0.3;  // [m] of a surgical microscope
constexpr double kLost = 1.0;             // [s] without a pose: hidden, more than a dropout
constexpr double kHorizon = 3.0;          // [s] beyond which a pose is no longer looked for

std::string text(const char* format, double value) {
  char buffer[40];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

}  // namespace

std::optional<Motion> motionAround(const ros::Time& stamp, const cortshift_stereo::PoseAt& pose_at) {
  std::vector<PoseSample> samples;
  bool known = false;
  const int steps = static_cast<int>(kHalfWindow / kStep);
  for (int i = -steps; i <= steps; ++i) {
    if (stamp.toSec() + i * kStep < 0) continue;  // before a simulated clock's zero there is no time
    try {
      samples.push_back({i * kStep, pose_at("pmr", "left_optical", cortshift_stereo::shifted(stamp, i * kStep))});
      known = known || i == 0;
    } catch (const cortshift_stereo::PoseError&) {  // a gap; what is left decides
    }
  }
  if (!known) return std::nullopt;
  const auto motion = motionOf(samples, kWorkingDistance);
  if (samples.size() < kFewest || !motion)
    throw TrackingError(
        "the tracker saw the microscope too seldom around the exposure to tell whether it stood still (" +
        std::to_string(samples.size()) + " of " + std::to_string(2 * steps + 1) +
        " instants); clear the tracker's line of sight");
  return motion;
}

void requireSlow(const Motion& motion, double max_speed) {
  if (motion.speed > max_speed)
    throw TrackingError("the microscope moved at " + text("%.1f mm/s", 1000 * motion.speed) +
                        " when the pair was exposed (max_speed is " + text("%.1f mm/s", 1000 * max_speed) +
                        "); let it stand still and capture again");
}

std::optional<Motion> PoseWatch::motionAt(const ros::Time& stamp) const {
  return motionAround(stamp, [this](const std::string& target, const std::string& source, const ros::Time& time) {
    const Eigen::Isometry3d T_target_source = poses_.lookup(target, source, time, ros::WallDuration(0));
    ever_ = true;
    return T_target_source;
  });
}

void PoseWatch::requireStill(const ros::Time& stamp) const {
  const auto motion = motionAt(stamp);
  if (!motion && ever_)
    throw TrackingError(
        "the tracker did not see the microscope when the pair was exposed; clear its line of sight and "
        "capture again");
  if (motion) requireSlow(*motion, max_speed_);
}

std::optional<double> PoseWatch::age(std::string* contradiction) const {
  const ros::Time now = ros::Time::now();
  for (double age = 0; age <= kHorizon && now.toSec() > age; age += kStep) {
    try {
      poses_.lookup("pmr", "left_optical", cortshift_stereo::shifted(now, -age), ros::WallDuration(0));
      ever_ = true;
      return age;
    } catch (const cortshift_stereo::PoseError& error) {  // not yet, or no longer
      if (contradiction && error.reason() == cortshift_stereo::PoseError::Reason::kTwoSources)
        *contradiction = error.what();
    }
  }
  return std::nullopt;
}

void PoseWatch::requireSeen() const {
  std::string contradiction;
  const auto now = age(&contradiction);
  if (!contradiction.empty()) throw TrackingError(contradiction);
  if (ever_ && !(now && *now <= kLost))
    throw TrackingError(
        "the tracker has not seen the microscope for " +
        (now ? text("%.1f s", *now) : text("more than %.0f s", kHorizon)) +
        "; clear its line of sight, or check the connection to it and that the clocks agree, and capture again");
}

}  // namespace cortshift_tracking
