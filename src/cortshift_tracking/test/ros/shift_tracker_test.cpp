// The node and the keys of its stages; requests, live mode and captures have files of their own.
#include "tracker_node.hpp"

namespace cortshift_tracking {
namespace {

TEST_F(ShiftTrackerNode, RefusesBadKeysAtOnce) {
  const ros::WallTime begin = ros::WallTime::now();
  for (const std::string& key : {std::string(), std::string("a b"), std::string("../x"), std::string(65, 'k'),
                                 std::string("caf\xc3\xa9"), std::string("n\0l", 3)}) {
    const auto response = capture(key);
    EXPECT_FALSE(response.success) << key;
    holds(response.message, "1-64 of A-Z a-z 0-9 _ -");
  }
  EXPECT_LT((ros::WallTime::now() - begin).toSec(), 1.9);  // none waited for a surface
  EXPECT_TRUE(list().empty());
}

TEST_F(ShiftTrackerNode, TheKeyOfTheMrIsNotForCaptures) {
  publish(cloudOf(rest, ros::Time::now()));
  const auto response = capture("pmr");
  EXPECT_FALSE(response.success);
  holds(response.message, "'pmr' stands for the preoperative MR");
  EXPECT_TRUE(list().empty());
}

TEST_F(ShiftTrackerNode, DeletesOnlyWhatIsThere) {
  publish(cloudOf(rest, ros::Time::now()));
  ASSERT_TRUE(capture("one").success);
  ASSERT_TRUE(capture("two").success);
  cortshift_msgs::DeleteStage service;
  service.request.key = "nine";
  ASSERT_TRUE(ros::service::call("/shift_tracker/delete_stage", service));
  EXPECT_FALSE(service.response.success);
  holds(service.response.message, "there are: one, two");
  service.request.key = "one";
  ASSERT_TRUE(ros::service::call("/shift_tracker/delete_stage", service));
  EXPECT_TRUE(service.response.success);
  ASSERT_EQ(list().size(), 1U);
  EXPECT_EQ(list()[0].key, "two");
  publish(cloudOf(rest, ros::Time::now()));  // by now the first one may be old
  ASSERT_TRUE(capture("one").success);       // the key is free again, and comes after "two" now
  ASSERT_EQ(list().size(), 2U);
  EXPECT_EQ(list()[1].key, "one");
}

}  // namespace
}  // namespace cortshift_tracking

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_shift_tracker");
  const ros::NodeHandle keep_alive;
  return RUN_ALL_TESTS();
}
