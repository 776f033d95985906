#include "cortshift_stereo/ros/reconstruction/surface_demand.hpp"

#include <gtest/gtest.h>

namespace cortshift_stereo {
namespace {

using std::chrono::milliseconds;

class SurfaceDemandTest : public testing::Test {
 protected:
  SurfaceDemand demand_;
  const SurfaceDemand::Time now_ = std::chrono::steady_clock::now();
  const ros::Time first_{100, 0}, second_{101, 0};
};

TEST_F(SurfaceDemandTest, EachPairIsWorkedOnUntilSomebodySaysWhenHeIsReady) {
  EXPECT_TRUE(demand_.waits(now_));
  demand_.served(first_);
  EXPECT_TRUE(demand_.waits(now_));
}

TEST_F(SurfaceDemandTest, TheNextOneWhenTheLastIsTaken) {
  demand_.served(first_);
  demand_.want(now_, first_);
  EXPECT_TRUE(demand_.waits(now_));
  demand_.served(second_);
  EXPECT_FALSE(demand_.waits(now_ + milliseconds(300)));
  demand_.want(now_ + milliseconds(300), second_);
  EXPECT_TRUE(demand_.waits(now_ + milliseconds(300)));
}

TEST_F(SurfaceDemandTest, NoneWhileOneIsOnItsWay) {
  demand_.served(first_);
  demand_.served(second_);
  demand_.want(now_, first_);
  EXPECT_FALSE(demand_.waits(now_));
  demand_.want(now_ + milliseconds(200), first_);  // it was lost
  EXPECT_TRUE(demand_.waits(now_ + milliseconds(200)));
}

TEST_F(SurfaceDemandTest, WhoHasNoneYetGetsOne) {
  demand_.served(first_);
  demand_.want(now_, ros::Time());
  EXPECT_TRUE(demand_.waits(now_));
}

TEST_F(SurfaceDemandTest, APairThatGivesNoSurfaceLeavesTheWordStanding) {
  demand_.want(now_, ros::Time());
  EXPECT_TRUE(demand_.waits(now_ + milliseconds(900)));
}

TEST_F(SurfaceDemandTest, WhoFallsSilentIsForgotten) {
  demand_.want(now_, ros::Time());
  demand_.served(first_);
  EXPECT_FALSE(demand_.waits(now_ + SurfaceDemand::kPatience - milliseconds(1)));
  EXPECT_TRUE(demand_.waits(now_ + SurfaceDemand::kPatience));
}

}  // namespace
}  // namespace cortshift_stereo
