#include "cortshift_tracking/surround/rigid_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "cortshift_tracking/surround/surround.hpp"
#include "surround/resting_scene.hpp"

namespace cortshift_tracking {
namespace {

Matrix6 loose() {
  Vector6 sd;
  sd << 1, 1, 1, 1, 1, 1;
  return sd.asDiagonal();
}

std::vector<MovedPiece> around(const Eigen::Isometry3d& transform, int count, double noise, unsigned seed) {
  cv::RNG random(seed);
  std::vector<MovedPiece> pieces;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d place(random.uniform(-0.04, 0.04), random.uniform(-0.03, 0.03),
                                random.uniform(-0.003, 0.003));
    const Eigen::Vector3d error(random.gaussian(noise), random.gaussian(noise), random.gaussian(noise));
    pieces.push_back({place, transform * place - place + error});
  }
  return pieces;
}

const Eigen::Isometry3d kTurned =
    Eigen::Translation3d(0.0008, -0.0005, 0.0011) * Eigen::AngleAxisd(0.007, Eigen::Vector3d(1, 2, -1).normalized());

TEST(RigidFit, FindsTheMotionAmongAsMuchThatMovedOtherwise) {
  std::vector<MovedPiece> pieces = around(kTurned, 60, 0.00003, 1);
  cv::RNG random(2);
  for (int i = 0; i < 50; ++i) pieces[static_cast<std::size_t>(i)].motion.z() += random.uniform(0.001, 0.01);
  for (const MovedPiece& piece : around(kTurned, 20, 0.00003, 3)) pieces.push_back(piece);
  RigidFitSettings settings;
  settings.hold = 1;
  const auto fit = fitRigid(pieces, loose(), settings);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(static_cast<double>(fit->count), 30, 2);
  for (const Eigen::Vector3d& corner : {Eigen::Vector3d(-0.04, -0.03, 0), Eigen::Vector3d(0.04, 0.03, 0)})
    EXPECT_LT((fit->transform * corner - kTurned * corner).norm(), 0.00004);
}

TEST(RigidFit, ItsCovarianceIsThatOfItsErrors) {
  RigidFitSettings settings;
  settings.hold = 1;
  double squared = 0;
  constexpr int kTrials = 100;
  for (unsigned trial = 0; trial < kTrials; ++trial) {
    const auto fit = fitRigid(around(kTurned, 80, 0.00005, 10 + trial), loose(), settings);
    ASSERT_TRUE(fit);
    const Eigen::Vector3d corner(0.04, -0.03, 0);
    squared += (fit->transform * corner - kTurned * corner).squaredNorm() /
               std::pow(sdAt(fit->covariance, fit->centre, corner), 2);
  }
  EXPECT_NEAR(std::sqrt(squared / kTrials), 1, 0.25);
}

TEST(RigidFit, WhatThePiecesDoNotTellStaysAsUncertainAsItWas) {
  std::vector<MovedPiece> line;  // says nothing about the rotation about itself
  for (int i = -20; i <= 20; ++i)
    line.push_back({Eigen::Vector3d(0.001 * i, 0.0001 * (i % 3), 0), Eigen::Vector3d::Zero()});
  line[5].place.y() = 0.004;  // so that triples are found
  line[30].place.y() = -0.004;
  Matrix6 prior = Matrix6::Zero();
  prior.diagonal() << 1e-6, 1e-6, 1e-6, 4e-6, 4e-6, 4e-6;
  for (MovedPiece& piece : line) piece.motion = Eigen::Vector3d(0.0004, 0, 0);
  const auto fit = fitRigid(line, prior);
  ASSERT_TRUE(fit);
  EXPECT_LT(fit->covariance(4, 4), 0.3 * prior(4, 4));
  EXPECT_GT(fit->covariance(3, 3), fit->covariance(4, 4) * 3);
  EXPECT_LE(fit->covariance(3, 3), prior(3, 3));
}

TEST(RigidFit, SaysNothingWithoutConsensus) {
  std::vector<MovedPiece> pieces = around(kTurned, 40, 0.01, 5);
  const auto fit = fitRigid(pieces, loose());
  EXPECT_TRUE(!fit || fit->count < 12);
  EXPECT_FALSE(fitRigid({}, loose()));
}

TEST(PoseUncertainty, TheFarCameraTurnsIntoSidewaysError) {
  const Eigen::Isometry3d above(Eigen::Translation3d(0, 0, 0.3));
  const PlacedCamera camera{above, {{"tracker", "configured", 0.0002, 0.001, false}}};
  const Matrix6 covariance = poseCovariance(camera, camera, Eigen::Vector3d::Zero());
  EXPECT_NEAR(covariance(2, 2), 2 * 0.0002 * 0.0002, 1e-12);                      // along the axis
  EXPECT_NEAR(covariance(0, 0), 2 * (0.0002 * 0.0002 + 0.0003 * 0.0003), 1e-12);  // and across it
  EXPECT_NEAR(sdAt(covariance, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()),
              std::sqrt(covariance.diagonal().head<3>().sum()), 1e-9);
}

TEST(PoseUncertainty, AtAnyPointItIsThatOfTheMotionThere) {
  Matrix6 root = Matrix6::Zero();
  for (int i = 0; i < 36; ++i) root(i / 6, i % 6) = 0.001 * ((7 * i + 3) % 11 - 5);
  const Matrix6 covariance = root * root.transpose();
  const Eigen::Vector3d centre(0.01, -0.02, 0.03), point(-0.04, 0.05, 0.02);
  const Matrix6 there = aboutCentre(covariance, centre, point);
  EXPECT_NEAR(sdAt(covariance, centre, point), std::sqrt(there.topLeftCorner<3, 3>().trace()), 1e-12);
}

TEST(PoseUncertainty, ACommonErrorCountsOnlyWhereTheCameraHasTurned) {
  const PoseErrorSource hand_eye{"hand-eye", "its file", 0.0003, 0.001, true};
  const Eigen::Isometry3d above(Eigen::Translation3d(0, 0, 0.3));
  const PlacedCamera camera{above, {hand_eye}};
  EXPECT_LT(poseCovariance(camera, camera, Eigen::Vector3d::Zero()).norm(), 1e-15);
  PlacedCamera turned = camera;
  turned.T_pmr_camera = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitZ()) * above;
  EXPECT_NEAR(poseCovariance(camera, turned, Eigen::Vector3d::Zero())(0, 0), 4 * (0.0003 * 0.0003 + 0.0003 * 0.0003),
              1e-9 * 1e-3);
}

TEST(PoseUncertainty, ALatencyOf20MillisecondsAt10MillimetresPerSecondIs200Micrometres) {
  const double way = 0.020 * 0.010 / std::sqrt(3);  // of each coordinate
  PlacedCamera moved{
      Eigen::Isometry3d(Eigen::Translation3d(0, 0, -0.3)), {{"latency", "configured", way, 0, false}}, {}};
  const Matrix6 covariance = poseCovariance({}, moved, Eigen::Vector3d::Zero());
  EXPECT_NEAR(sdAt(covariance, Eigen::Vector3d::Zero(), Eigen::Vector3d(0.02, 0, 0)), 0.0002, 1e-12);
}

TEST(PoseUncertainty, AMeasuredTrembleIsPartOfWhatIsConfigured) {
  const std::vector<PoseErrorSource> tremble{{kTremble, "measured", 0.0003, 0.0005, false}};
  const PoseErrorSource beside = trackerBeside(tremble, 0.0005, 0.0004);
  EXPECT_NEAR(beside.translation_sd, 0.0004, 1e-12);  // 3, 4, 5
  EXPECT_EQ(beside.rotation_sd, 0) << "more than configured is measured";
  EXPECT_EQ(trackerBeside({}, 0.0005, 0.0004).translation_sd, 0.0005);
}

/// A camera above the origin that looks down on it.
PlacedCamera above(double height, const DepthErrorSource& source) {
  Eigen::Isometry3d T_pmr_camera(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  T_pmr_camera.translation().z() = height;
  return {T_pmr_camera, {}, {source}};
}

double depthSd(const PlacedCamera& earlier, const PlacedCamera& later) {
  return sdAt(poseCovariance(earlier, later, Eigen::Vector3d::Zero()), Eigen::Vector3d::Zero(),
              Eigen::Vector3d::Zero());
}

TEST(PoseUncertainty, AWrongFocalLengthCountsByHowMuchFartherTheCameraIs) {
  const DepthErrorSource one_percent{"stereo calibration", "its report", 0.01, 0};
  EXPECT_LT(depthSd(above(0.3, one_percent), above(0.3, one_percent)), 1e-12);
  EXPECT_NEAR(depthSd(above(0.3, one_percent), above(0.31, one_percent)), 0.0001, 1e-9);
}

TEST(PoseUncertainty, ADisparityCountsByTheSquareOfTheDepth) {
  const double pixel = 1 / (3840 * 0.025);
  const DepthErrorSource zoomed{"zoom", "at 1.2", 0, 0.2 * pixel}, other{"zoom", "at 0.8", 0, 0.2 * pixel};
  const double once = 0.2 * 0.3 * 0.3 * pixel;  // 0.19 mm
  EXPECT_NEAR(depthSd(above(0.3, {}), above(0.3, zoomed)), once, 1e-9) << "one stage at another setting";
  EXPECT_NEAR(depthSd(above(0.3, other), above(0.3, zoomed)), once * std::sqrt(2), 1e-9) << "two settings, two errors";
  EXPECT_LT(depthSd(above(0.3, zoomed), above(0.3, zoomed)), 1e-12) << "one setting, one error";
}

TEST(PoseUncertainty, TheReferenceSettingNeedsNoWarp) {
  const SettingsError error{1.0, 0.3, 0.001};
  EXPECT_FALSE(error.counts(NAN, NAN));
  EXPECT_FALSE(error.counts(1.001, 0.3));
  EXPECT_TRUE(error.counts(1.0, 0.31));
  EXPECT_TRUE(error.counts(0.8, 0.3));
}

}  // namespace
}  // namespace cortshift_tracking
