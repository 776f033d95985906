// Which requests make a stage, and what the others are told.
#include "tracker_node.hpp"

namespace cortshift_tracking {
namespace {

TEST_F(ShiftTrackerNode, TimesOutWithTheReasonOfTheReconstruction) {
  ros::Duration(2.5).sleep();  // what another test published is too old by now
  diagnostic_msgs::DiagnosticArray message;
  message.status.resize(1);
  message.status[0].name = "surface_reconstruction: surface";
  message.status[0].values.resize(2);
  message.status[0].values[0].key = "last_drop_reason";
  message.status[0].values[0].value = "no pose of microscope near the stamp";
  message.status[0].values[1].key = "last_drop_stamp";
  message.status[0].values[1].value = "12.5";
  diagnostics.publish(message);
  ros::WallDuration(0.3).sleep();
  const auto response = capture("never");
  EXPECT_FALSE(response.success);
  holds(response.message, "'never'");
  holds(response.message, "/surface/points");
  holds(response.message, "no pose of microscope near the stamp");
  holds(response.message, "12.5");
  EXPECT_TRUE(list().empty());
}

TEST_F(ShiftTrackerNode, MalformedSurfacesAreNamedAndSurvived) {
  auto cloud = cloudOf(rest, ros::Time::now());
  cloud.data.resize(cloud.data.size() / 2);
  publish(cloud);
  auto other_frame = cloudOf(rest, ros::Time::now());
  other_frame.header.frame_id = "map";
  publish(other_frame);
  const auto response = capture("malformed");
  EXPECT_FALSE(response.success);
  holds(response.message, "its frame is 'map', not pmr");
  bool reported = false;
  for (int i = 0; i < 30 && !reported; ++i) {
    const auto array = latched<diagnostic_msgs::DiagnosticArray>("/diagnostics");
    for (const auto& status : array->status)
      reported |= status.name == "shift_tracker: surfaces" && status.level == diagnostic_msgs::DiagnosticStatus::ERROR;
  }
  EXPECT_TRUE(reported);

  auto empty = rest;
  empty.points = cv::Mat(rest.points.size(), CV_32FC3, cv::Scalar::all(std::nan("")));
  publish(cloudOf(empty, ros::Time::now()));
  const auto nothing = capture("empty");
  EXPECT_FALSE(nothing.success);
  holds(nothing.message, "too few connected points");
}

TEST_F(ShiftTrackerNode, TakesARecentSurfaceAndRefusesAnOldOne) {
  publish(cloudOf(rest, ros::Time::now() - ros::Duration(10)));
  EXPECT_FALSE(capture("old").success);
  const ros::Time stamp = ros::Time::now();
  publish(cloudOf(rest, stamp));
  const auto response = capture("now", "after opening");
  ASSERT_TRUE(response.success) << response.message;
  EXPECT_EQ(response.stage.key, "now");
  EXPECT_EQ(response.stage.note, "after opening");
  EXPECT_EQ(response.stage.stamp, stamp);
  EXPECT_EQ(response.stage.valid_points, 360U * 270U);
  EXPECT_DOUBLE_EQ(response.stage.coverage, 1.0);
  EXPECT_TRUE(std::isnan(response.stage.settings.magnification));
  EXPECT_NEAR(response.stage.camera_pose.position.x, camera.T_pmr_camera.translation()[0], 1e-9);

  const auto again = capture("now");
  EXPECT_FALSE(again.success);
  holds(again.message, "'now' exists already");
  ASSERT_EQ(list().size(), 1U);
}

TEST_F(ShiftTrackerNode, ASurfaceThatArrivesWhileTheRequestWaits) {
  ros::WallDuration(2.5).sleep();  // what other tests published is too old by now
  ros::AsyncSpinner spinner(1);
  spinner.start();
  const ros::Time asked = ros::Time::now();
  ros::NodeHandle node;
  const ros::WallTimer during = node.createWallTimer(
      ros::WallDuration(0.7), [](const ros::WallTimerEvent&) { surfaces.publish(cloudOf(rest, ros::Time::now())); },
      true);
  const auto response = capture("waited");
  ASSERT_TRUE(response.success) << response.message;
  EXPECT_GE(response.stage.stamp, asked - ros::Duration(2.0));
}

}  // namespace
}  // namespace cortshift_tracking
