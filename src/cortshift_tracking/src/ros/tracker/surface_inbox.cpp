#include "cortshift_tracking/ros/tracker/surface_inbox.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "cortshift_stereo/admission/limits.hpp"

namespace cortshift_tracking {
namespace {

/// In floating point: ros::Time itself cannot go below zero.
bool olderThan(const ros::Time& stamp, const ros::Time& now, const ros::Duration& age) {
  return now.toSec() - stamp.toSec() > age.toSec();
}

}  // namespace

void SurfaceInbox::put(const sensor_msgs::PointCloud2ConstPtr& surface) {
  {
    const std::lock_guard<std::mutex> guard(mutex_);
    surfaces_.push_back(surface);
    if (surfaces_.size() > kKept) surfaces_.pop_front();
    ++count_;
  }
  arrived_.notify_all();
}

void SurfaceInbox::noteReceived(const ros::Time& stamp, const ros::Time& received) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    received_[stamp] = received;
    while (received_.size() > 4 * kKept)
      received_.erase(received_.begin()->first < stamp ? received_.begin() : std::prev(received_.end()));
  }
  arrived_.notify_all();
}

ros::Time SurfaceInbox::exposed(const sensor_msgs::PointCloud2& surface) const {
  const ros::Time& stamp = surface.header.stamp;
  const auto found = received_.find(stamp);
  const bool one_clock = found == received_.end() ||
                         std::abs(found->second.toSec() - stamp.toSec()) <= cortshift_stereo::ClockLimits::kLive;
  return one_clock ? stamp : found->second;
}

unsigned long SurfaceInbox::count() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return count_;
}

sensor_msgs::PointCloud2ConstPtr SurfaceInbox::waitSince(const ros::Time& stamp, unsigned long seen,
                                                         Deadline deadline) const {
  std::unique_lock<std::mutex> lock(mutex_);
  sensor_msgs::PointCloud2ConstPtr found;
  arrived_.wait_until(lock, deadline, [&] {
    unsigned long number = count_ - surfaces_.size();
    for (auto surface = surfaces_.begin(); surface != surfaces_.end() && !found; ++surface)
      if (++number > seen && (*surface)->header.stamp >= stamp) found = *surface;
    return found != nullptr;
  });
  return found;
}

sensor_msgs::PointCloud2ConstPtr SurfaceInbox::waitForRecent(const ros::Duration& max_age, Deadline deadline) const {
  const ros::Time asked = ros::Time::now();
  std::unique_lock<std::mutex> lock(mutex_);
  if (!asked.isZero() && !surfaces_.empty()) {
    const ros::Time stamp = exposed(*surfaces_.back());
    // A stamp far ahead of the clock is of a recording that has been started again since.
    if (!olderThan(stamp, asked, max_age) && !olderThan(asked, stamp, max_age)) return surfaces_.back();
  }
  unsigned long seen = count_;
  sensor_msgs::PointCloud2ConstPtr found;
  arrived_.wait_until(lock, deadline, [&] {
    if (count_ == seen) return false;
    seen = count_;
    const ros::Time reference = std::min(asked, ros::Time::now());  // the clock may have been set back
    if (!olderThan(exposed(*surfaces_.back()), reference, max_age)) found = surfaces_.back();
    return found != nullptr;
  });
  return found;
}

sensor_msgs::PointCloud2ConstPtr SurfaceInbox::waitForNewer(unsigned long& seen,
                                                            std::chrono::milliseconds patience) const {
  std::unique_lock<std::mutex> lock(mutex_);
  if (!arrived_.wait_for(lock, patience, [&] { return count_ > seen; })) return {};
  seen = count_;
  return surfaces_.back();
}

ros::Time SurfaceInbox::newestStamp() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return surfaces_.empty() ? ros::Time() : surfaces_.back()->header.stamp;
}

}  // namespace cortshift_tracking
