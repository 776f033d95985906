// The surfaces that the reconstruction sends, and why none comes.
#pragma once

#include <cortshift_msgs/SurfaceStatus.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <ros/subscriber.h>
#include <sensor_msgs/PointCloud2.h>

#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <string>

#include "cortshift_stereo/ros/clock_watch.hpp"
#include "cortshift_tracking/ros/tracker/surface_inbox.hpp"

namespace cortshift_tracking {

/// Takes usable surfaces into an inbox. Thread-safe.
///
/// Subscribes:
///   /surface/points [sensor_msgs/PointCloud2] organised surface in pmr
///   /surface/status [cortshift_msgs/SurfaceStatus] what goes with each of them
///   /diagnostics [diagnostic_msgs/DiagnosticArray] why the reconstruction dropped a pair
/// Publishes:
///   /surface/wanted [std_msgs/Header] a surface is waited for; stamp of the one that was taken last, zero: any will do
class SurfaceFeed {
 public:
  explicit SurfaceFeed(ros::NodeHandle& node);

  const SurfaceInbox& inbox() const { return inbox_; }

  using Deadline = SurfaceInbox::Deadline;

  /// As those of the inbox, and the reconstruction is told that somebody waits.
  sensor_msgs::PointCloud2ConstPtr waitSince(const ros::Time& stamp, unsigned long seen, Deadline deadline) const;
  sensor_msgs::PointCloud2ConstPtr waitForRecent(const ros::Duration& max_age, Deadline deadline) const;

  /// @param taken  stamp of the surface that this caller took last; zero: none
  sensor_msgs::PointCloud2ConstPtr waitForNewer(unsigned long& seen, const ros::Time& taken,
                                                std::chrono::milliseconds patience) const;

  /// What the reconstruction says of the surface of this stamp; it may come a moment after the surface. Null where it
  /// says nothing.
  cortshift_msgs::SurfaceStatusConstPtr statusOf(const ros::Time& stamp) const;

  /// Parameters of the reconstruction; empty: it has said nothing yet.
  std::string reconstructionParameters() const;

  /// For a refusal: what is known of why no surface comes; begins with "; ".
  std::string whyNone() const;

  struct Report {
    unsigned long received = 0, malformed = 0;
    std::string last_malformed;  ///< why the last one was not usable; empty: it was
    std::string clock;           ///< what is wrong with the clock that ages are told by; empty: nothing
  };
  Report report() const;

 private:
  void ask(const ros::Time& taken) const;
  void onSurface(const sensor_msgs::PointCloud2ConstPtr& surface);
  void onStatus(const cortshift_msgs::SurfaceStatusConstPtr& status);
  void onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& message);

  SurfaceInbox inbox_;
  mutable std::mutex mutex_;
  Report report_;
  std::string parameters_;                                               // of the reconstruction
  std::string reconstruction_, drop_reason_, drop_stamp_;                // what the reconstruction says
  std::map<ros::Time, cortshift_msgs::SurfaceStatusConstPtr> statuses_;  // the last few
  mutable std::condition_variable status_came_;
  mutable cortshift_stereo::ClockWatch clock_;
  mutable std::string clock_trouble_;  // as of the last report
  ros::Subscriber surfaces_, status_, diagnostics_;
  ros::Publisher wanted_;
};

}  // namespace cortshift_tracking
