#include "cortshift_tracking/igtl/space.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace cortshift_tracking::igt {
namespace {

Eigen::Isometry3d somePose() {
  return Eigen::Translation3d(0.0123, -0.0456, 0.2789) *
         Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, -2, 3).normalized()) * Eigen::Isometry3d::Identity();
}

Eigen::Matrix4d matrixMm(const Eigen::Isometry3d& pose) {
  Eigen::Matrix4d matrix_mm = pose.matrix();
  matrix_mm.topRightCorner<3, 1>() *= 1000;
  return matrix_mm;
}

TEST(LinkSpace, KeepsBodiesInTheirOwnAxes) {
  const LinkSpace space(Axes::kRas, Axes::kLps);
  const auto T = space.poseFromLink(matrixMm(somePose()), "reference", "microscope");
  EXPECT_TRUE(T.isApprox(somePose(), 1e-12));
}

// A point of the reference body, taken to the patient once by the peer in LPS and once by us in RAS, is one point.
TEST(LinkSpace, LandmarkIsTheSameInBothAxes) {
  const LinkSpace space(Axes::kRas, Axes::kLps);
  const Eigen::Vector3d landmark_reference(0.011, 0.023, -0.037);
  const Eigen::Matrix4d lps_mm = matrixMm(somePose());
  const Eigen::Vector3d landmark_lps_mm = (lps_mm * (1000 * landmark_reference).homogeneous()).head<3>();
  const Eigen::Vector3d expected_ras(-landmark_lps_mm.x() / 1000, -landmark_lps_mm.y() / 1000,
                                     landmark_lps_mm.z() / 1000);
  const Eigen::Vector3d landmark_pmr = space.poseFromLink(lps_mm, "pmr", "reference") * landmark_reference;
  EXPECT_LT((landmark_pmr - expected_ras).norm(), 1e-12);
  EXPECT_LT((space.vectorToLink(landmark_pmr) - landmark_lps_mm).norm(), 1e-9);
  EXPECT_LT((space.vectorFromLink(landmark_lps_mm) - landmark_pmr).norm(), 1e-12);
}

TEST(LinkSpace, EveryPoseComesBack) {
  for (const Axes pmr : {Axes::kRas, Axes::kLps})
    for (const Axes link : {Axes::kRas, Axes::kLps})
      for (const char* parent : {"pmr", "reference"})
        for (const char* child : {"pmr", "microscope"}) {
          const LinkSpace space(pmr, link);
          const auto T = space.poseFromLink(space.poseToLink(somePose(), parent, child), parent, child);
          EXPECT_TRUE(T.isApprox(somePose(), 1e-12)) << parent << " " << child;
          EXPECT_NEAR(T.linear().determinant(), 1, 1e-12);
        }
}

TEST(LinkSpace, RefusesWhatIsNoPose) {
  const LinkSpace space(Axes::kRas, Axes::kRas);
  const Eigen::Matrix4d good = matrixMm(somePose());
  const auto refused = [&](int row, int column, double factor) {
    Eigen::Matrix4d bad = good;
    bad(row, column) *= factor;
    EXPECT_THROW(space.poseFromLink(bad, "reference", "microscope"), PoseError) << row << column << factor;
  };
  refused(0, 3, std::numeric_limits<double>::quiet_NaN());
  refused(2, 2, std::numeric_limits<double>::infinity());
  refused(1, 1, 1.01);
  refused(3, 3, 2);
  Eigen::Matrix4d mirrored = good;
  mirrored.col(0) *= -1;
  EXPECT_THROW(space.poseFromLink(mirrored, "reference", "microscope"), PoseError);
  EXPECT_THROW(space.poseFromLink(Eigen::Matrix4d::Zero(), "reference", "microscope"), PoseError);
}

TEST(LinkSpace, RoundsTheRotationOfSinglePrecisionMatrices) {
  const LinkSpace space(Axes::kRas, Axes::kRas);
  const Eigen::Matrix4d coarse = matrixMm(somePose()).cast<float>().cast<double>();
  const auto T = space.poseFromLink(coarse, "reference", "microscope");
  EXPECT_LT((T.linear() * T.linear().transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  EXPECT_LT((T.translation() - somePose().translation()).norm(), 1e-7);
}

TEST(Axes, NamesOnlyTwo) {
  EXPECT_EQ(axesFromText("lps"), Axes::kLps);
  EXPECT_THROW(axesFromText("RAS"), std::invalid_argument);
}

}  // namespace
}  // namespace cortshift_tracking::igt
