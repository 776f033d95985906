// Speed and jitter of a tracked camera against motions that are known.
#include "cortshift_tracking/matching/motion.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

namespace cortshift_tracking {
namespace {

constexpr double kDistance = 0.3;

template <typename Pose>
std::vector<PoseSample> samplesOf(const Pose& pose_at) {
  std::vector<PoseSample> samples;
  for (int i = -5; i <= 5; ++i) samples.push_back({0.05 * i, pose_at(0.05 * i)});
  return samples;
}

Eigen::Isometry3d at(const Eigen::Vector3d& translation) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = translation;
  return T;
}

TEST(Motion, StandingStillIsExactlyNothing) {
  const auto motion = motionOf(samplesOf([](double) { return at({0.1, -0.2, 0.3}); }), kDistance);
  ASSERT_TRUE(motion);
  EXPECT_NEAR(motion->speed, 0, 1e-12);
  EXPECT_NEAR(motion->jitter, 0, 1e-12);
}

TEST(Motion, UniformTranslation) {
  const Eigen::Vector3d velocity(0.003, -0.004, 0.012);  // 13 mm/s
  const auto motion = motionOf(samplesOf([&](double t) { return at(velocity * t); }), kDistance);
  EXPECT_NEAR(motion->speed, 0.013, 1e-9);
  EXPECT_NEAR(motion->jitter, 0, 1e-9);
}

TEST(Motion, ATurnMovesWhatTheCameraLooksAt) {
  const double rate = 0.02;  // [rad/s]: 6 mm/s at 300 mm, though the camera stands still
  const auto motion = motionOf(samplesOf([&](double t) {
                                 Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
                                 T.linear() = Eigen::AngleAxisd(rate * t, Eigen::Vector3d::UnitX()).toRotationMatrix();
                                 return T;
                               }),
                               kDistance);
  EXPECT_NEAR(motion->speed, rate * kDistance, 1e-6);
}

TEST(Motion, JitterIsToldFromMotion) {
  std::mt19937 random(5);
  std::normal_distribution<double> deviate(0, 0.0002);
  double largest = 0, squares = 0;
  constexpr int kRounds = 200;
  for (int round = 0; round < kRounds; ++round) {
    const auto motion = motionOf(samplesOf([&](double) {
                                   return at({deviate(random), deviate(random), deviate(random)});
                                 }),
                                 kDistance);
    largest = std::max(largest, motion->speed);
    squares += motion->jitter * motion->jitter / kRounds;
  }
  EXPECT_LT(largest, 0.0025);                                               // half of the default max_speed
  EXPECT_NEAR(std::sqrt(squares), 0.0002 * std::sqrt(3 * 9 / 11.0), 2e-5);  // two of eleven degrees are fitted
}

TEST(Motion, TooFewSamplesAreNoMotion) {
  EXPECT_FALSE(motionOf({}, kDistance));
  EXPECT_FALSE(motionOf({{0, at({0, 0, 0})}, {1, at({1, 0, 0})}}, kDistance));
  EXPECT_FALSE(motionOf({{1, at({0, 0, 0})}, {1, at({1, 0, 0})}, {1, at({2, 0, 0})}}, kDistance));
}

}  // namespace
}  // namespace cortshift_tracking
