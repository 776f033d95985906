#include "cortshift_stereo/ros/pose_lookup.hpp"

#include <gtest/gtest.h>
#include <rosgraph_msgs/Clock.h>
#include <tf2_msgs/TFMessage.h>

#include <thread>

namespace cortshift_stereo {
namespace {

/// Publishes pmr -> reference -> microscope -> left_optical by hand, so that each test decides what is late or missing.
class PoseLookupTest : public ::testing::Test {
 protected:
  PoseLookupTest() : lookup(0.1) {
    moving = node.advertise<tf2_msgs::TFMessage>("/tf", 100);
    fixed = node.advertise<tf2_msgs::TFMessage>("/tf_static", 1, true);
    tf2_msgs::TFMessage calibration;
    calibration.transforms = {edge("pmr", "/reference", 0, 1), edge("/microscope", "left_optical", 0, 2)};
    fixed.publish(calibration);
    while (moving.getNumSubscribers() == 0 || fixed.getNumSubscribers() == 0) ros::WallDuration(0.01).sleep();
  }

  static geometry_msgs::TransformStamped edge(const std::string& parent, const std::string& child, double t, double x) {
    geometry_msgs::TransformStamped out;
    out.header.frame_id = parent;
    out.header.stamp = ros::Time(1000 + t);
    out.child_frame_id = child;
    out.transform.translation.x = x;
    out.transform.rotation.w = 1;
    return out;
  }
  void track(double t, double x) {
    tf2_msgs::TFMessage message;
    message.transforms = {edge("reference", "microscope", t, x)};
    moving.publish(message);
  }
  double x(double t, double timeout) {
    return lookup.lookup("pmr", "left_optical", ros::Time(1000 + t), ros::WallDuration(timeout)).translation().x();
  }

  ros::NodeHandle node;
  ros::Publisher moving;
  ros::Publisher fixed;
  PoseLookup lookup;
};

constexpr double kLong = 20;  // [s] what must arrive arrives long before

TEST_F(PoseLookupTest, waitsForTheSampleAfterTheStamp) {
  track(0.00, 10);
  std::thread tracker([this] {
    ros::WallDuration(0.3).sleep();
    track(0.08, 18);
  });
  EXPECT_NEAR(x(0.04, kLong), 1 + 14 + 2, 1e-9);
  tracker.join();
}

TEST_F(PoseLookupTest, refusesWhenTheSampleNeverComes) {
  track(0.00, 10);
  track(0.05, 10);
  EXPECT_NO_THROW(x(0.05, kLong));
  try {
    x(0.06, 0.3);
    FAIL();
  } catch (const PoseError& error) {
    EXPECT_EQ(error.reason(), PoseError::Reason::kGapAfter) << error.what();
  }
}

TEST_F(PoseLookupTest, aGapThatCannotHealIsRefusedAtOnce) {
  track(0.0, 10);
  track(0.5, 10);
  EXPECT_NO_THROW(x(0.5, kLong));
  const ros::WallTime start = ros::WallTime::now();
  EXPECT_THROW(x(0.2, 600), PoseError);
  EXPECT_LT((ros::WallTime::now() - start).toSec(), 300);
}

TEST_F(PoseLookupTest, aClockThatJumpsBackClearsSamplesButNotTheCalibration) {
  ros::Time::setNow(ros::Time(1000.5));  // simulated time from here
  track(0.4, 10);
  track(0.5, 10);
  EXPECT_NO_THROW(x(0.45, kLong));
  ros::Time::setNow(ros::Time(1000.0));
  track(0.0, 77);
  EXPECT_NEAR(x(0.0, kLong), 1 + 77 + 2, 1e-9);
  EXPECT_THROW(x(0.45, 0.2), PoseError) << "a pose of the run before";
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "pose_lookup_test");
  return RUN_ALL_TESTS();
}
