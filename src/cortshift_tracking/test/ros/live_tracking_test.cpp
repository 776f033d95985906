// The shift to every new surface.
#include <cortshift_msgs/TrackShift.h>

#include "tracker_node.hpp"

namespace cortshift_tracking {
namespace {

TEST_F(ShiftTrackerNode, LiveModePublishesAFieldForTheNewestSurfaces) {
  publish(cloudOf(rest, ros::Time::now()));
  ASSERT_TRUE(capture("a").success);
  cortshift_msgs::TrackShift track;
  track.request.on = true;
  track.request.key = "nine";
  ASSERT_TRUE(ros::service::call("/shift_tracker/track", track));
  EXPECT_FALSE(track.response.success);
  track.request.key = "a";
  ASSERT_TRUE(ros::service::call("/shift_tracker/track", track));
  ASSERT_TRUE(track.response.success) << track.response.message;

  std::vector<ros::Time> stamps;
  std::vector<std::pair<double, double>> late;  // what the fields say, and what it took to compute them [s]
  cortshift_msgs::DisplacementFieldConstPtr last;
  ros::NodeHandle node;
  const ros::Subscriber fields [[maybe_unused]] = node.subscribe<cortshift_msgs::DisplacementField>(
      "/shift/field", 10,
      boost::function<void(const cortshift_msgs::DisplacementFieldConstPtr&)>([&](const auto& message) {
        if (message->to_key.empty()) {
          stamps.push_back(message->to_stamp);
          late.emplace_back(message->summary.latency, message->summary.compute_time);
        }
        last = message;
      }));
  ros::Time newest;
  for (int i = 0; i < 40; ++i) {
    newest = ros::Time::now();
    surfaces.publish(cloudOf(i % 2 == 0 ? rest : sagged, newest));
    ros::WallDuration(0.1).sleep();
    ros::spinOnce();
  }
  for (int i = 0; i < 100 && (stamps.empty() || stamps.back() != newest); ++i) {
    ros::WallDuration(0.1).sleep();
    ros::spinOnce();
  }
  ASSERT_GE(stamps.size(), 2U);
  EXPECT_EQ(stamps.back(), newest);  // whatever was passed over, the newest was not
  EXPECT_TRUE(std::is_sorted(stamps.begin(), stamps.end()));
  EXPECT_EQ(last->from_key, "a");
  EXPECT_EQ(last->resolution, 0.0002);
  const double now = ros::Time::now().toSec();
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    EXPECT_GT(late[i].first, late[i].second);
    EXPECT_LT(late[i].first, now - stamps[i].toSec());
  }
  EXPECT_GT(last->summary.magnitude_mean, 0.003);  // the last one was the sagged surface
  track.request.on = false;
  ASSERT_TRUE(ros::service::call("/shift_tracker/track", track));
  EXPECT_TRUE(track.response.success);
  const std::size_t count = stamps.size();
  ros::spinOnce();
  surfaces.publish(cloudOf(rest, ros::Time::now()));
  ros::WallDuration(1.5).sleep();
  ros::spinOnce();
  EXPECT_LE(stamps.size(), count + 1);  // one may have been under way
}

}  // namespace
}  // namespace cortshift_tracking
