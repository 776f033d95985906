#include "cortshift_stereo/geometry/transform_tree.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace cortshift_stereo {
namespace {

using Reason = PoseError::Reason;

constexpr int64_t kSecond = 1000000000;
constexpr int64_t kStart = 1700000000 * kSecond;  // a wall-clock stamp: too large for a double of nanoseconds

int64_t at(double seconds) { return kStart + std::llround(1e9 * seconds); }

Eigen::Quaterniond turn(double angle) { return Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ())); }

/// pmr -> reference (fixed) -> microscope (moving: x = 0.1 m/s t, turning 0.2 rad/s) -> left_optical (fixed).
class TransformTreeTest : public ::testing::Test {
 protected:
  TransformTreeTest() : tree(0.1, 60) {
    tree.addFixed("pmr", "reference", {1, 2, 3}, turn(0.5));
    tree.addFixed("microscope", "left_optical", {0, 0, 0.3}, turn(-0.2));
    tree.addFixed("pmr", "head", {0, 0, 1}, turn(0));
  }
  void track(double t) { tree.addSample("reference", "microscope", at(t), {0.1 * t, 0, 0}, turn(0.2 * t)); }

  Eigen::Isometry3d truth(double t) const {
    return Eigen::Translation3d(1, 2, 3) * turn(0.5) * Eigen::Translation3d(0.1 * t, 0, 0) * turn(0.2 * t) *
           Eigen::Translation3d(0, 0, 0.3) * turn(-0.2);
  }
  void expectRefused(double t, Reason reason, bool may_heal, const std::string& named) const {
    try {
      tree.lookup("pmr", "left_optical", at(t));
      FAIL() << "a pose came back";
    } catch (const PoseError& error) {
      EXPECT_EQ(error.reason(), reason) << error.what();
      EXPECT_EQ(error.mayHeal(), may_heal) << error.what();
      EXPECT_NE(std::string(error.what()).find(named), std::string::npos) << error.what();
    }
  }
  TransformTree tree;
};

TEST_F(TransformTreeTest, interpolatesBetweenSamplesOnEitherSide) {
  for (const double t : {0.0, 0.05, 0.1, 0.15}) track(t);
  for (const double t : {0.0, 0.02, 0.05, 0.149}) {
    const Eigen::Isometry3d T = tree.lookup("pmr", "left_optical", at(t));
    EXPECT_LT((T.matrix() - truth(t).matrix()).norm(), 1e-9) << t;
    EXPECT_TRUE((tree.lookup("left_optical", "pmr", at(t)) * T).matrix().isIdentity(1e-9));
  }
}

TEST_F(TransformTreeTest, edgesThatAreNotBetweenTheFramesAreNotAskedFor) {
  const Eigen::Isometry3d T = tree.lookup("head", "reference", at(0));  // meets at pmr; the tracker has said nothing
  EXPECT_LT((T.translation() - Eigen::Vector3d(1, 2, 2)).norm(), 1e-12);
}

TEST_F(TransformTreeTest, missingFramesAreNamed) {
  expectRefused(0, Reason::kNotConnected, true, "left_optical");
  track(0);
  try {
    tree.lookup("pmr", "left", at(0));
    FAIL();
  } catch (const PoseError& error) {
    EXPECT_EQ(error.reason(), Reason::kMissingFrame);
    EXPECT_NE(std::string(error.what()).find("frame left "), std::string::npos) << error.what();
  }
}

TEST_F(TransformTreeTest, gapsAreRefusedAndOnlyALaterSampleCanHeal) {
  track(0.0);
  expectRefused(-0.01, Reason::kGapBefore, false, "reference -> microscope");
  expectRefused(0.01, Reason::kGapAfter, true, "reference -> microscope");
  track(0.105);
  EXPECT_NO_THROW(tree.lookup("pmr", "left_optical", at(0.05)));
  expectRefused(0.001, Reason::kGapAfter, false, "0.104000 s away");
  expectRefused(0.104, Reason::kGapBefore, false, "0.104000 s away");
  track(0.05);  // late and out of order
  EXPECT_NO_THROW(tree.lookup("pmr", "left_optical", at(0.001)));
}

TEST_F(TransformTreeTest, aSampleThatIsNotRigidIsNeverSteppedOver) {
  track(0);
  track(0.1);
  EXPECT_NO_THROW(tree.lookup("pmr", "left_optical", at(0.06)));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  tree.addSample("reference", "microscope", at(0.05), {nan, 0, 0}, turn(0));
  expectRefused(0.06, Reason::kNotRigid, false, "reference -> microscope");
  expectRefused(0.05, Reason::kNotRigid, false, "reference -> microscope");
  tree.addSample("reference", "microscope", at(0.15), {0, 0, 0}, Eigen::Quaterniond(0, 0, 0, 0));
  expectRefused(0.14, Reason::kNotRigid, false, "reference -> microscope");
  EXPECT_NO_THROW(tree.lookup("pmr", "left_optical", at(0.1)));
}

TEST_F(TransformTreeTest, aBrokenCalibrationIsRefused) {
  track(0);
  tree.addFixed("microscope", "left_optical", {0, 0, 0.3}, Eigen::Quaterniond(1, 1, 0, 0));
  expectRefused(0, Reason::kNotRigid, false, "microscope -> left_optical");
}

TEST_F(TransformTreeTest, aChangedParentIsRefused) {
  track(0);
  tree.addSample("pmr", "microscope", at(0.05), {0, 0, 0}, turn(0));
  expectRefused(0.02, Reason::kNotConnected, false, "changes its parent");
}

TEST_F(TransformTreeTest, loopsOfFramesEndInAnError) {
  tree.addFixed("left_optical", "pmr", {0, 0, 0}, turn(0));
  track(0);
  expectRefused(0, Reason::kNotConnected, false, "loop");
}

TEST_F(TransformTreeTest, forgettingKeepsFixedEdges) {
  track(0);
  tree.forgetSamples();
  expectRefused(0, Reason::kNotConnected, true, "left_optical");
  track(0);
  EXPECT_NO_THROW(tree.lookup("pmr", "left_optical", at(0)));
}

TEST_F(TransformTreeTest, aRecordingThatStartsAgainStartsItsEdgeAnew) {
  track(100);
  track(100.05);
  track(0);
  track(0.05);
  EXPECT_NO_THROW(tree.lookup("pmr", "left_optical", at(0.02)));
  expectRefused(100, Reason::kGapAfter, true, "reference -> microscope");
}

TEST_F(TransformTreeTest, oldSamplesAreLetGo) {
  track(0);
  track(30);
  track(61);
  expectRefused(0, Reason::kGapBefore, false, "no sample before");
}

}  // namespace
}  // namespace cortshift_stereo
