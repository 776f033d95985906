#include "cortshift_tracking/ros/tracker/surface_feed.hpp"

#include <ros/console.h>
#include <std_msgs/Header.h>

#include <algorithm>
#include <chrono>
#include <iterator>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_stereo/ros/pose_tree.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/ros/run_folder.hpp"

namespace cortshift_tracking {
namespace {

const char* const kReconstructionStatus = "surface_reconstruction: surface";

}  // namespace

SurfaceFeed::SurfaceFeed(ros::NodeHandle& node)
    : surfaces_(node.subscribe("surface/points", 2, &SurfaceFeed::onSurface, this)),
      status_(node.subscribe("surface/status", 8, &SurfaceFeed::onStatus, this)),
      diagnostics_(node.subscribe("/diagnostics", 20, &SurfaceFeed::onDiagnostics, this)),
      wanted_(node.advertise<std_msgs::Header>("surface/wanted", 1)) {}

void SurfaceFeed::ask(const ros::Time& taken) const {
  std_msgs::Header message;
  message.stamp = taken;
  wanted_.publish(message);
}

sensor_msgs::PointCloud2ConstPtr SurfaceFeed::waitSince(const ros::Time& stamp, unsigned long seen,
                                                        Deadline deadline) const {
  constexpr std::chrono::milliseconds kAgain{200};  // what was made first may be of an older pair
  while (true) {
    ask(ros::Time());
    const Deadline now = std::chrono::steady_clock::now();
    if (auto surface = inbox_.waitSince(stamp, seen, std::min(deadline, now + kAgain))) return surface;
    if (now + kAgain >= deadline) return {};
  }
}

sensor_msgs::PointCloud2ConstPtr SurfaceFeed::waitForRecent(const ros::Duration& max_age, Deadline deadline) const {
  ask(ros::Time());
  return inbox_.waitForRecent(max_age, deadline);
}

sensor_msgs::PointCloud2ConstPtr SurfaceFeed::waitForNewer(unsigned long& seen, const ros::Time& taken,
                                                           std::chrono::milliseconds patience) const {
  ask(taken);
  return inbox_.waitForNewer(seen, patience);
}

void SurfaceFeed::onSurface(const sensor_msgs::PointCloud2ConstPtr& surface) {
  std::string reason;
  try {
    if (cortshift_stereo::withoutSlash(surface->header.frame_id) != "pmr")
      throw TrackingError("its frame is '" + surface->header.frame_id + "', not pmr");
    cortshift_stereo::requireSurface(*surface);
    inbox_.put(surface);
  } catch (const std::exception& error) {
    reason = error.what();
    ROS_ERROR_STREAM_THROTTLE(5, "a surface on /surface/points is not usable: " << reason);
  }
  const std::lock_guard<std::mutex> guard(mutex_);
  ++report_.received;
  report_.last_malformed = reason;
  if (!reason.empty()) ++report_.malformed;
}

void SurfaceFeed::onStatus(const cortshift_msgs::SurfaceStatusConstPtr& status) {
  constexpr std::size_t kKept = 64;
  const ros::Time& stamp = status->header.stamp;
  if (!status->received.isZero()) inbox_.noteReceived(stamp, status->received);
  {
    const std::lock_guard<std::mutex> guard(mutex_);
    statuses_[stamp] = status;
    while (statuses_.size() > kKept)
      statuses_.erase(statuses_.begin()->first < stamp ? statuses_.begin() : std::prev(statuses_.end()));
    parameters_ = status->parameters;
  }
  status_came_.notify_all();
}

cortshift_msgs::SurfaceStatusConstPtr SurfaceFeed::statusOf(const ros::Time& stamp) const {
  constexpr std::chrono::milliseconds kBehind{500};  // topics do not overtake one another by more
  if (status_.getNumPublishers() == 0) return {};
  std::unique_lock<std::mutex> lock(mutex_);
  cortshift_msgs::SurfaceStatusConstPtr found;
  status_came_.wait_for(lock, kBehind, [&] {
    const auto status = statuses_.find(stamp);
    if (status != statuses_.end()) found = status->second;
    return found != nullptr;
  });
  return found;
}

std::string SurfaceFeed::reconstructionParameters() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return parameters_;
}

void SurfaceFeed::onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& message) {
  for (const diagnostic_msgs::DiagnosticStatus& status : message->status) {
    if (status.name != statusName(kReconstructionStatus)) continue;
    const std::lock_guard<std::mutex> guard(mutex_);
    reconstruction_ = status.message;
    for (const diagnostic_msgs::KeyValue& value : status.values) {
      if (value.key == "last_drop_reason") drop_reason_ = value.value;
      if (value.key == "last_drop_stamp") drop_stamp_ = value.value;
    }
  }
}

std::string SurfaceFeed::whyNone() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  std::string why = clock_trouble_.empty() ? "" : "; " + clock_trouble_;
  const ros::Time newest = inbox_.newestStamp();
  why += newest.isZero() ? "; none has come since the node started"
                         : "; the newest is of " + std::to_string(newest.toSec());
  if (!report_.last_malformed.empty()) why += "; the last malformed one: " + report_.last_malformed;
  if (!drop_reason_.empty())
    why += "; the reconstruction last dropped a pair (" + drop_stamp_ + "): " + drop_reason_;
  else if (!reconstruction_.empty())
    why += "; the reconstruction says: " + reconstruction_;
  else
    why += "; nothing is heard of the reconstruction: check that surface_reconstruction runs and images flow";
  return why;
}

SurfaceFeed::Report SurfaceFeed::report() const {
  const std::string trouble = clock_.trouble();
  const std::lock_guard<std::mutex> guard(mutex_);
  clock_trouble_ = trouble;
  Report report = report_;
  report.clock = trouble;
  return report;
}

}  // namespace cortshift_tracking
