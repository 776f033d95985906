#include "cortshift_stereo/ros/surface_demand.hpp"

#include <gtest/gtest.h>

namespace cortshift_stereo {
namespace {

using std::chrono::milliseconds;

class SurfaceDemandTest : public testing::Test {
 protected:
  SurfaceDemand demand_;
  const SurfaceDemand::Time now_ = std::chrono::steady_clock::now();
};

TEST_F(SurfaceDemandTest, EachPairIsWorkedOnUntilSomebodySaysWhenHeIsReady) {
  EXPECT_TRUE(demand_.waits(now_));
  demand_.served();
  EXPECT_TRUE(demand_.waits(now_));
}

TEST_F(SurfaceDemandTest, OneSurfaceForEachWord) {
  demand_.want(now_);
  EXPECT_TRUE(demand_.waits(now_));
  demand_.served();
  EXPECT_FALSE(demand_.waits(now_ + milliseconds(300)));
  demand_.want(now_ + milliseconds(300));
  EXPECT_TRUE(demand_.waits(now_ + milliseconds(300)));
}

TEST_F(SurfaceDemandTest, APairThatGivesNoSurfaceLeavesTheWordStanding) {
  demand_.want(now_);
  EXPECT_TRUE(demand_.waits(now_ + milliseconds(900)));
}

TEST_F(SurfaceDemandTest, WhoFallsSilentIsForgotten) {
  demand_.want(now_);
  demand_.served();
  EXPECT_FALSE(demand_.waits(now_ + milliseconds(999)));
  EXPECT_TRUE(demand_.waits(now_ + milliseconds(1000)));
}

}  // namespace
}  // namespace cortshift_stereo
