// Tremble, two publishers, repetition and a tracker that stands still, each with what must not be taken for it.
#include "cortshift_stereo/admission/pose_evidence.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <random>

#include "cortshift_stereo/admission/view_memory.hpp"

namespace cortshift_stereo {
namespace {

using testing::HasSubstr;

constexpr int64_t kPeriod = 50000000;      // [ns] 20 Hz
constexpr int64_t kExposure = 1000000000;  // [ns]

/// Samples of reference -> microscope over 2 s; `at` gives the place [m] of the nth.
template <typename Place>
TransformTree treeOf(const Place& at, double seconds = 2) {
  TransformTree tree(0.15, 60);
  tree.addFixed("pmr", "reference", {0, 0, 0}, Eigen::Quaterniond::Identity());
  tree.addFixed("microscope", "left", {0, 0, 0}, Eigen::Quaterniond::Identity());
  const int count = static_cast<int>(seconds * 20);
  for (int n = 0; n <= count; ++n)
    tree.addSample("reference", "microscope", n * kPeriod, at(n), Eigen::Quaterniond::Identity());
  return tree;
}

Findings judge(const TransformTree& tree, int64_t stamp = kExposure) {
  return checkPoses(tree, "pmr", "left", stamp, PoseLimits());
}

class Noise {
 public:
  explicit Noise(double sd_per_axis, unsigned seed = 1) : engine_(seed), normal_(0, sd_per_axis) {}
  Eigen::Vector3d operator()() { return {normal_(engine_), normal_(engine_), normal_(engine_)}; }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
};

TEST(Poses, ATrackerThatMeasuresIsAccepted) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    Noise noise(0.00008, seed);  // 0.14 mm in space
    EXPECT_TRUE(judge(treeOf([&](int) { return noise(); })).all().empty()) << seed;
  }
}

/// Root mean square over trials of what exposureMotion says.
template <typename Value>
double overTrials(const Value& value, int64_t stamp) {
  double squares = 0;
  constexpr int kTrials = 200;
  for (unsigned seed = 0; seed < kTrials; ++seed) {
    Noise noise(0.0001, seed);
    const auto motion = exposureMotion(treeOf([&](int) { return noise(); }), "pmr", "left", stamp);
    squares += std::pow(value(motion.value()), 2) / kTrials;
  }
  return std::sqrt(squares);
}

TEST(ExposureMotion, TheTrembleIsThatOfTheSamples) {
  const auto tremble = [](const ExposureMotion& motion) { return motion.tremble.translation; };
  EXPECT_NEAR(overTrials(tremble, kExposure), 0.0001, 0.00001) << "at a sample";
  EXPECT_NEAR(overTrials(tremble, kExposure + kPeriod / 2), 0.0001 / std::sqrt(2), 0.000007) << "between two samples";
  EXPECT_LT(overTrials([](const ExposureMotion& motion) { return motion.tremble.rotation; }, kExposure), 1e-9);
}

TEST(ExposureMotion, TheSpeedIsThatOfTheCameraAndOfWhatItLooksAt) {
  const auto ways =
      exposureMotion(treeOf([](int n) { return Eigen::Vector3d(0.0005 * n, 0, 0); }), "pmr", "left", kExposure);
  ASSERT_TRUE(ways);
  EXPECT_NEAR(ways->speed.translation, 0.010 / std::sqrt(3), 1e-9);  // 10 mm/s
  EXPECT_LT(ways->tremble.translation, 1e-9);
  TransformTree turning(0.15, 60);
  for (int n = 0; n <= 40; ++n)
    turning.addSample("pmr", "left", n * kPeriod, {0, 0, 0},
                      Eigen::Quaterniond(Eigen::AngleAxisd(0.001 * n, Eigen::Vector3d::UnitX())));
  const auto turn = exposureMotion(turning, "pmr", "left", kExposure);
  ASSERT_TRUE(turn);
  // 20 mrad/s move what is 0.3 m away by 6 mm/s, in which two axes share.
  EXPECT_NEAR(turn->speed.rotation, 0.020 / std::sqrt(2), 1e-6);
  EXPECT_LT(turn->speed.translation, 1e-9);
}

TEST(ExposureMotion, FewSamplesSayNothing) {
  TransformTree tree(0.15, 60);
  for (int n = 0; n < 3; ++n)
    tree.addSample("pmr", "left", kExposure + n * kPeriod, {0, 0, 0}, Eigen::Quaterniond::Identity());
  EXPECT_FALSE(exposureMotion(tree, "pmr", "left", kExposure));
}

TEST(Poses, WithoutNoiseTheyAreAccepted) {
  EXPECT_TRUE(judge(treeOf([](int) { return Eigen::Vector3d(0.1, 0.2, 0.3); })).all().empty());
}

TEST(Poses, SteadyMotionIsNoTremble) {
  EXPECT_TRUE(judge(treeOf([](int n) { return Eigen::Vector3d(0.0002 * n, 0, 0); })).all().empty());  // 4 mm/s
  EXPECT_TRUE(
      judge(treeOf([](int n) { return Eigen::Vector3d(0.00001 * n * n, 0, 0); })).all().empty());  // faster and faster
}

TEST(Poses, TwoPublishersInTurnAreRefused) {
  for (const double apart : {0.005, 0.001, 0.0002}) {
    const Findings found = judge(treeOf([&](int n) { return Eigen::Vector3d(n % 2 == 0 ? 0 : apart, 0, 0); }));
    ASSERT_NE(found.refusal(), nullptr) << apart;
    EXPECT_EQ(found.refusal()->check, CheckId::kPosePublishers);
    EXPECT_THAT(found.refusal()->sentence(), HasSubstr("reference -> microscope"));
    EXPECT_THAT(found.refusal()->sentence(), HasSubstr("two publishers"));
  }
}

TEST(Poses, TheSecondPublisherMayBeTheRarerOne) {
  const Findings found = judge(treeOf([](int n) { return Eigen::Vector3d(n % 4 == 0 ? 0.004 : 0, 0, 0); }));
  ASSERT_NE(found.refusal(), nullptr);
}

TEST(Poses, TrembleIsWarnedOfAndThenRefused) {
  Noise some(0.0003), much(0.002);
  const Findings warned = judge(treeOf([&](int) { return some(); }));
  EXPECT_EQ(warned.verdict(), Verdict::kWarn);
  EXPECT_THAT(warned.warnings().front(), HasSubstr("trembles by"));
  EXPECT_THAT(warned.warnings().front(), HasSubstr("tracker_jitter"));
  EXPECT_EQ(judge(treeOf([&](int) { return much(); })).verdict(), Verdict::kRefuse);
}

TEST(Poses, OneSampleThatJumpsIsWarnedOf) {
  const Findings found = judge(treeOf([](int n) { return Eigen::Vector3d(n == 20 ? 0.0004 : 0, 0, 0); }));
  EXPECT_EQ(found.verdict(), Verdict::kWarn);
  EXPECT_THAT(found.warnings().front(), HasSubstr("jumps by 0.40 mm"));
}

TEST(Poses, ATrackerThatRepeatsItselfIsRefused) {
  Noise noise(0.0001);
  std::vector<Eigen::Vector3d> said;
  for (int n = 0; n <= 60; ++n) said.push_back(noise());
  for (int n = 35; n <= 60; ++n) said[static_cast<std::size_t>(n)] = said[10];  // back to an earlier pose, bit by bit
  const TransformTree back = treeOf([&](int n) { return said[static_cast<std::size_t>(n)]; }, 3);
  const Findings found = judge(back, 2000000000);
  ASSERT_NE(found.refusal(), nullptr);
  EXPECT_EQ(found.refusal()->check, CheckId::kPoseRepeated);
  EXPECT_THAT(found.refusal()->sentence(), HasSubstr("bit by bit"));
  EXPECT_TRUE(judge(back, 1000000000).all().empty());
}

TEST(Poses, ATrackerThatRoundsIsNotTakenForOneThatRepeatsItself) {
  constexpr double kStep = 0.00001;  // [m] of what it says
  const auto rounded = [kStep](const Eigen::Vector3d& place) -> Eigen::Vector3d {
    return (place / kStep).array().round().matrix() * kStep;
  };
  for (const double sd : {0.000006, 0.00001, 0.00002, 0.00005})
    for (unsigned seed = 1; seed <= 20; ++seed) {
      Noise noise(sd, seed);
      std::vector<Eigen::Vector3d> said;
      for (int n = 0; n <= 400; ++n) said.push_back(rounded(noise()));
      const auto tree = [&said] { return treeOf([&](int n) { return said[static_cast<std::size_t>(n)]; }, 20); };
      const TransformTree measures = tree();
      for (int64_t stamp = 11 * kExposure; stamp <= 19 * kExposure; stamp += kExposure)
        EXPECT_TRUE(judge(measures, stamp).all().empty()) << sd << " " << seed << " " << stamp;
      if (sd < kStep) continue;  // two of three are the same: nothing to tell a tracker by that stands still
      for (std::size_t n = 200; n <= 400; ++n) said[n] = said[199];
      const Findings found = judge(tree(), 12 * kExposure);
      ASSERT_NE(found.refusal(), nullptr) << sd;
      EXPECT_EQ(found.refusal()->check, CheckId::kPoseRepeated);
    }
}

TEST(Poses, WithoutNoiseTheyMayComeBackAfterAShake) {
  // It stands, is shaken for a while, and stands where it stood, as a simulated microscope on a busy machine.
  const auto place = [](int n) {
    const bool shaken = n > 60 && n < 90;
    return Eigen::Vector3d(shaken ? (n % 2 == 0 ? 0.003 : -0.003) + 0.0001 * n : 0, 0, 0);
  };
  EXPECT_TRUE(judge(treeOf(place, 8), 6000000000).all().empty());
}

TEST(Poses, WithoutNoiseTheyMayGoBackTheWayTheyCame) {
  const auto place = [](int n) { return Eigen::Vector3d(0.0002 * std::min(n, 100 - n), 0, 0); };
  for (const int64_t stamp : {2 * kExposure, 7 * kExposure / 2})
    EXPECT_TRUE(judge(treeOf(place, 5), stamp).all().empty());
}

TEST(Edges, AFixedAndAMovingSourceAreRefusedUnlessTheyAgree) {
  const auto both = [](double apart) {
    TransformTree tree = treeOf([](int) { return Eigen::Vector3d(0.1, 0, 0); });
    tree.addFixed("reference", "microscope", {0.1 + apart, 0, 0}, Eigen::Quaterniond::Identity());
    return tree;
  };
  EXPECT_NO_THROW(both(0).lookup("pmr", "left", kExposure));
  try {
    both(0.001).lookup("pmr", "left", kExposure);
    FAIL() << "accepted";
  } catch (const PoseError& error) {
    EXPECT_EQ(error.reason(), PoseError::Reason::kTwoSources);
    EXPECT_THAT(error.what(), HasSubstr("reference -> microscope is fixed on /tf_static"));
  }
}

TEST(Edges, TwoPosesOfOneStampAreTwoSources) {
  TransformTree tree = treeOf([](int) { return Eigen::Vector3d(0.1, 0, 0); });
  tree.addSample("reference", "microscope", 10 * kPeriod, {0.1, 0, 0}, Eigen::Quaterniond::Identity());
  EXPECT_NO_THROW(tree.lookup("pmr", "left", 10 * kPeriod + 1)) << "said twice alike";
  tree.addSample("reference", "microscope", 10 * kPeriod, {0.105, 0, 0}, Eigen::Quaterniond::Identity());
  for (const int64_t stamp : {10 * kPeriod - 1, 10 * kPeriod, 10 * kPeriod + 1}) try {
      tree.lookup("pmr", "left", stamp);
      FAIL() << "accepted";
    } catch (const PoseError& error) {
      EXPECT_EQ(error.reason(), PoseError::Reason::kTwoSources);
      EXPECT_THAT(error.what(), HasSubstr("reference -> microscope came twice at 0.500000 s, with two poses"));
    }
  EXPECT_NO_THROW(tree.lookup("pmr", "left", 12 * kPeriod));
}

TEST(Edges, TwoFixedOnesAtOnceAreRefusedAndALaterOneReplaces) {
  TransformTree tree(0.15, 60);
  const auto rotation = Eigen::Quaterniond::Identity();
  tree.addFixed("pmr", "left", {0, 0, 0}, rotation, 10.0);
  tree.addFixed("pmr", "left", {0, 0, 0}, rotation, 10.1);  // the same once more
  EXPECT_NO_THROW(tree.lookup("pmr", "left", kExposure));
  tree.addFixed("pmr", "left", {0.003, 0, 0}, rotation, 10.2);
  EXPECT_THROW(tree.lookup("pmr", "left", kExposure), PoseError);
  tree.addFixed("pmr", "left", {0.003, 0, 0}, rotation, 30.0);
  EXPECT_NEAR(tree.lookup("pmr", "left", kExposure).translation().x(), 0.003, 1e-12);
}

/// A textured image, as a camera that was moved by some pixels sees it; `seed` of the noise.
cv::Mat view(double shift, int seed, bool brain_moved = false) {
  cv::RNG scene(7);
  cv::Mat big(460, 620, CV_32FC3);
  scene.fill(big, cv::RNG::NORMAL, 0, 40);
  cv::GaussianBlur(big, big, {}, 3);
  big = 120 + 6 * big;
  const cv::Mat moved = (cv::Mat_<double>(2, 3) << 1, 0, -30 - shift, 0, 1, -30);
  cv::Mat image;
  cv::warpAffine(big, image, moved, {512, 384});
  if (brain_moved) {
    const cv::Mat brain = (cv::Mat_<double>(2, 3) << 1, 0, -50, 0, 1, -15);
    cv::Mat other;
    cv::warpAffine(big, other, brain, {512, 384});
    const cv::Rect middle(140, 100, 230, 180);
    other(middle).copyTo(image(middle));
  }
  cv::Mat noise(image.size(), CV_32FC3);
  cv::RNG(static_cast<uint64_t>(seed)).fill(noise, cv::RNG::NORMAL, 0, 1);
  image += noise;
  image.convertTo(image, CV_8UC3);
  return image;
}

TEST(Views, OnePoseShowsOneSurrounding) {
  const auto optics = std::make_shared<int>(0);
  const Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d other = pose;
  other.translation().x() = 1e-9;
  ViewMemory views;
  EXPECT_TRUE(views.add(1, pose, view(0, 1), optics).all().empty());
  EXPECT_TRUE(views.add(2, pose, view(0, 2), optics).all().empty());
  EXPECT_TRUE(views.add(3, pose, view(0, 3, true), optics).all().empty()) << "the brain has moved, not the camera";
  EXPECT_TRUE(views.add(4, other, view(12, 4), optics).all().empty()) << "the pose says that the camera has moved";
  EXPECT_TRUE(views.add(5, pose, view(12, 5), std::make_shared<int>(1)).all().empty()) << "zoomed";
  const Findings stuck = views.add(6, pose, view(12, 6), optics);
  ASSERT_NE(stuck.refusal(), nullptr);
  EXPECT_EQ(stuck.refusal()->check, CheckId::kPoseStuck);
  EXPECT_THAT(stuck.refusal()->sentence(), HasSubstr("the tracker repeats itself"));
}

TEST(Views, OneImageIsNotSeenFromTwoPlaces) {
  const auto optics = std::make_shared<int>(0);
  Eigen::Isometry3d here = Eigen::Isometry3d::Identity(), there = here, elsewhere = here;
  there.translation().x() = 0.004;
  elsewhere.translation().x() = 0.008;
  ViewMemory views;
  EXPECT_TRUE(views.add(1, here, view(0, 1), optics).all().empty());
  EXPECT_TRUE(views.add(2, there, view(30, 2), optics).all().empty());
  const Findings repeated = views.add(3, elsewhere, view(30, 2), optics);
  ASSERT_NE(repeated.refusal(), nullptr);
  EXPECT_EQ(repeated.refusal()->check, CheckId::kImageRepeated);
}

TEST(Views, WithoutTextureNothingIsSaid) {
  EXPECT_FALSE(surroundingsMoved(cv::Mat(384, 512, CV_8UC3, cv::Scalar::all(90)),
                                 cv::Mat(384, 512, CV_8UC3, cv::Scalar::all(140))));
}

}  // namespace
}  // namespace cortshift_stereo
