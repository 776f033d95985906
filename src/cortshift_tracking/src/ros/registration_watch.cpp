#include "cortshift_tracking/ros/registration_watch.hpp"

#include <ros/console.h>

namespace cortshift_tracking {

void RegistrationWatch::add(const tf2_msgs::TFMessage& message) {
  const std::lock_guard<std::mutex> guard(mutex_);
  if (history_.add(message, ros::Time::now()))
    ROS_WARN("the patient registration has changed: stages from now on belong to another epoch");
}

geometry_msgs::Pose RegistrationWatch::newest() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return history_.newest();
}

void RegistrationWatch::requireSettled(const ros::Time& stamp) const {
  const std::lock_guard<std::mutex> guard(mutex_);
  const auto changed = history_.changed();
  if (!changed || *changed > ros::Time::now()) return;  // a clock that was set back: another play of a bag
  cortshift_tracking::requireSettled(stamp, *changed);
}

}  // namespace cortshift_tracking
