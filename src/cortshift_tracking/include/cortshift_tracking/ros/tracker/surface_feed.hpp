// The surfaces that the reconstruction sends, and why none comes.
#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <sensor_msgs/PointCloud2.h>

#include <mutex>
#include <string>

#include "cortshift_tracking/ros/tracker/surface_inbox.hpp"

namespace cortshift_tracking {

/// Takes usable surfaces into an inbox. Thread-safe.
///
/// Subscribes:
///   /surface/points [sensor_msgs/PointCloud2] organised surface in pmr
///   /diagnostics [diagnostic_msgs/DiagnosticArray] why the reconstruction dropped a pair
class SurfaceFeed {
 public:
  explicit SurfaceFeed(ros::NodeHandle& node);

  const SurfaceInbox& inbox() const { return inbox_; }

  /// For a refusal: what is known of why no surface comes; begins with "; ".
  std::string whyNone() const;

  struct Report {
    unsigned long received = 0, malformed = 0;
    std::string last_malformed;  ///< why the last one was not usable; empty: it was
  };
  Report report() const;

 private:
  void onSurface(const sensor_msgs::PointCloud2ConstPtr& surface);
  void onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& message);

  SurfaceInbox inbox_;
  mutable std::mutex mutex_;
  Report report_;
  std::string reconstruction_, drop_reason_, drop_stamp_;  // what the reconstruction says
  ros::Subscriber surfaces_, diagnostics_;
};

}  // namespace cortshift_tracking
