// The phantom as a camera: the pairs of its scene one after the other, and none while the microscope moves.
#include "sources/phantom/phantom_source.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "cortshift_stereo_phantom/phantom_case.hpp"

namespace cortshift_stereo {
namespace {

const cortshift_stereo_phantom::PhantomCase& description() {
  static const auto parsed = cortshift_stereo_phantom::parsePhantomCase(
      "{name: small, cameras: {size: [160, 120]}, image: {supersampling: 1, noise: 0.01}, "
      "stages: [{name: first}, {name: second, microscope: {roll: 0.1}}]}",
      "test");
  return parsed;
}

class PhantomSourceTest : public testing::Test {
 protected:
  double now_ = 10;
  PhantomSource source_{description(), "", {}, 0.1, [this] { return fromSeconds(now_); }};
};

TEST_F(PhantomSourceTest, GivesThePairsOfItsSceneInTurn) {
  cortshift_stereo_phantom::PhantomPairs pairs(
      std::make_shared<const cortshift_stereo_phantom::PhantomScene>(description()));
  for (const std::uint64_t frame : {0, 1, 2}) {
    const StereoPair fired = source_.fire();
    const auto expected = pairs.take(0, frame);
    EXPECT_EQ(cv::norm(fired.left, expected.left, cv::NORM_INF), 0) << frame;
    EXPECT_EQ(cv::norm(fired.right, expected.right, cv::NORM_INF), 0) << frame;
    EXPECT_GT(cv::norm(fired.left, pairs.take(0, frame + 1).left, cv::NORM_INF), 0) << "each has its own noise";
    EXPECT_EQ(fired.stamp, fromSeconds(now_));
    now_ += 0.1;
  }
}

TEST_F(PhantomSourceTest, GivesNoneWhileTheMicroscopeMoves) {
  source_.fire();
  now_ += 0.5;
  const Stamp again = source_.setStage("second");
  now_ = std::chrono::duration<double>(again).count() - 0.05;
  EXPECT_THROW(source_.fire(), SourceError);
  now_ += 0.1;
  EXPECT_EQ(source_.fire().stamp, fromSeconds(now_));
  EXPECT_EQ(source_.stageName(), "second");
}

}  // namespace
}  // namespace cortshift_stereo
