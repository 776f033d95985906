#include "cortshift_tracking/ros/tracker/surface_inbox.hpp"

#include <gmock/gmock.h>

#include <boost/make_shared.hpp>

namespace cortshift_tracking {
namespace {

sensor_msgs::PointCloud2ConstPtr surfaceAt(double stamp) {
  auto surface = boost::make_shared<sensor_msgs::PointCloud2>();
  surface->header.stamp.fromSec(stamp);
  return surface;
}

const SurfaceInbox::Deadline kNow{};

TEST(SurfaceInbox, WhatCameBeforeTheExposureIsNotItsSurface) {
  SurfaceInbox inbox;
  inbox.put(surfaceAt(101.5));
  inbox.put(surfaceAt(102.0));
  const unsigned long seen = inbox.count();
  // The clock is set back by 2 s, and a pair is fired at 100.4.
  const ros::Time fired(100.4);
  EXPECT_EQ(inbox.waitSince(fired, seen, kNow), nullptr);
  inbox.put(surfaceAt(100.4));
  ASSERT_NE(inbox.waitSince(fired, seen, kNow), nullptr);
  EXPECT_EQ(inbox.waitSince(fired, seen, kNow)->header.stamp, fired);
}

TEST(SurfaceInbox, TheNextPairDoesWhereOneIsPassedOver) {
  SurfaceInbox inbox;
  const unsigned long seen = inbox.count();
  inbox.put(surfaceAt(100.3));
  EXPECT_EQ(inbox.waitSince(ros::Time(100.4), seen, kNow), nullptr);
  inbox.put(surfaceAt(100.5));
  ASSERT_NE(inbox.waitSince(ros::Time(100.4), seen, kNow), nullptr);
}

}  // namespace
}  // namespace cortshift_tracking
