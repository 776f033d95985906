#include "cortshift_tracking/surround/surround.hpp"

#include <gmock/gmock.h>

#include <cmath>

#include "surround/resting_scene.hpp"

namespace cortshift_tracking {
namespace {

using testing::HasSubstr;
using Matter = RestingScene::Matter;

constexpr double kDegree = M_PI / 180;

struct Judged {
  Surround surround;
  ErrorsAgainst before, after;
};

Judged judge(const RestingScene& scene, const Eigen::Isometry3d& drift, const SurroundSettings& settings = {},
             const PairKnowledge& knowledge = {}) {
  DisplacementField field = scene.seen(drift);
  Judged out;
  out.before = errorsOnBrain(field.displacement_pmr, scene);
  out.surround = assessSurround(field, knowledge, settings);
  if (out.surround.corrected) takeOut(out.surround.transform, field.start_pmr, field.displacement_pmr);
  out.after = errorsOnBrain(field.displacement_pmr, scene);
  return out;
}

/// Right to 0.25 mm, or refused by name.
void expectRightOrRefused(const Judged& judged) {
  if (judged.surround.corrected)
    EXPECT_LT(judged.after.p95, 0.00025) << judged.surround.text;
  else
    EXPECT_THAT(judged.surround.text, HasSubstr("no correction: ")) << judged.before.median;
}

TEST(Surround, DriftsOfATrackerAreTakenOut) {
  double square = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    RestingScene scene;
    scene.seed = seed;
    const Eigen::Isometry3d drift =
        RestingScene::drift(seed, 0.0015 * (seed % 5 + 1) / 5, 0.4 * kDegree * (seed % 4) / 3);
    const Judged judged = judge(scene, drift);
    ASSERT_TRUE(judged.surround.corrected) << "drift " << seed << ": " << judged.surround.text;
    EXPECT_LT(judged.after.median, judged.before.median);
    EXPECT_LT(judged.after.median, 0.00012);
    EXPECT_LT(judged.after.p95, 0.00035);
    const Eigen::Vector3d middle = RestingScene::middle_pmr();
    square += std::pow((judged.surround.transform * middle - drift * middle).norm() /
                           sdAt(judged.surround.covariance, judged.surround.centre, middle),
                       2) /
              20;
  }
  EXPECT_LT(std::sqrt(square), 1.5) << "more wrong than its covariance says";
}

TEST(Surround, ABrainThatSagsIsNotChangedWhereTrackingIsRight) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    RestingScene scene;
    scene.seed = seed;
    scene.sag = 0.002 * seed;
    const Judged judged = judge(scene, Eigen::Isometry3d::Identity());
    EXPECT_EQ(judged.surround.finding, SurroundFinding::kAgrees) << judged.surround.text;
    EXPECT_FALSE(judged.surround.corrected);
    EXPECT_THAT(judged.surround.text, HasSubstr("agrees with tracking"));
    EXPECT_TRUE(judged.surround.warnings.empty());
  }
}

TEST(Surround, NoBoneInViewIsNoEvidence) {
  RestingScene close;
  close.radius_x = close.radius_y = 0.08;
  const Judged judged = judge(close, RestingScene::drift(3, 0.001, 0));
  EXPECT_EQ(judged.surround.finding, SurroundFinding::kUnseen);
  EXPECT_THAT(judged.surround.text, HasSubstr("bone around the brain in view"));
  // 0.25 mm and 0.0017 rad of each pose at 0.3 m: 1.2 mm of a vector.
  EXPECT_NEAR(sdAt(judged.surround.covariance, judged.surround.centre, RestingScene::middle_pmr()), 0.00118, 0.00005);
}

TEST(Surround, ADrapeThatSlidesDoesNotMislead) {
  RestingScene scene;
  scene.movement = [](double, double, Matter matter) {
    return matter == Matter::kDrape ? Eigen::Vector3d(0.003, 0, 0) : Eigen::Vector3d(0, 0, 0);
  };
  const Judged judged = judge(scene, RestingScene::drift(4, 0.001, 0.2 * kDegree));
  ASSERT_TRUE(judged.surround.corrected) << judged.surround.text;
  EXPECT_LT(judged.after.p95, 0.00025);
}

TEST(Surround, CottonOnTheBrainIsNoBone) {
  RestingScene scene;
  scene.cover = [](double x, double y, Matter matter) {
    return std::hypot(x + 0.004, y) < 0.009 ? Matter::kCotton : matter;
  };
  const Judged judged = judge(scene, RestingScene::drift(5, 0.0008, 0.1 * kDegree));
  ASSERT_TRUE(judged.surround.corrected) << judged.surround.text;
  EXPECT_LT(judged.after.p95, 0.00025);
}

TEST(Surround, ARetractorOverAFifthOfTheRimDoesNotMislead) {
  for (const bool moves : {false, true}) {
    RestingScene scene;
    scene.cover = [moves](double x, double y, Matter matter) {
      const bool blade = std::abs(std::atan2(y, x)) < M_PI / 5 && std::hypot(x, y) > 0.02;
      return !blade ? matter : moves ? Matter::kCotton : Matter::kNothing;
    };
    scene.movement = [](double, double, Matter matter) {
      return matter == Matter::kCotton ? Eigen::Vector3d(0.002, 0.001, 0.0005) : Eigen::Vector3d(0, 0, 0);
    };
    const Judged judged = judge(scene, RestingScene::drift(6, 0.001, 0.2 * kDegree));
    expectRightOrRefused(judged);
    if (!moves) {
      EXPECT_TRUE(judged.surround.corrected) << judged.surround.text;
    }
  }
}

TEST(Surround, BoneOnOneSideIsRightOrRefused) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    RestingScene scene;
    scene.seed = seed;
    scene.cover = [](double x, double, Matter matter) {
      return x > -0.015 && matter != Matter::kBrain ? Matter::kNothing : matter;
    };
    expectRightOrRefused(judge(scene, RestingScene::drift(seed, 0.001, 0.2 * kDegree)));
  }
}

TEST(Surround, TwoPartsThatMovedDifferentlyAreRefusedByName) {
  RestingScene scene;
  scene.movement = [](double x, double, Matter matter) {
    return matter == Matter::kBone && x > 0 ? Eigen::Vector3d(0.001, 0, 0.0005) : Eigen::Vector3d(0, 0, 0);
  };
  const Judged judged = judge(scene, RestingScene::drift(7, 0.0005, 0));
  EXPECT_EQ(judged.surround.finding, SurroundFinding::kUnclear);
  EXPECT_FALSE(judged.surround.corrected);
  EXPECT_THAT(judged.surround.text, HasSubstr("contradicts itself"));
  EXPECT_THAT(judged.surround.warnings, testing::ElementsAre(HasSubstr("moved differently")));
}

TEST(Surround, WhatMovedMoreThanTrackingIsOffByIsRefused) {
  const Judged judged = judge(RestingScene(), RestingScene::drift(8, 0.012, 0));
  EXPECT_FALSE(judged.surround.corrected);
  EXPECT_THAT(judged.surround.text, HasSubstr("more than tracking is off by"));
}

TEST(Surround, CheckWarnsAndOffLooksAtNothing) {
  SurroundSettings settings;
  settings.mode = SurroundMode::kCheck;
  const Eigen::Isometry3d drift = RestingScene::drift(9, 0.001, 0);
  const Judged checked = judge(RestingScene(), drift, settings);
  EXPECT_EQ(checked.surround.finding, SurroundFinding::kDisagrees);
  EXPECT_FALSE(checked.surround.corrected);
  EXPECT_THAT(checked.surround.warnings, testing::ElementsAre(HasSubstr("moved by 1.0")));
  settings.mode = SurroundMode::kOff;
  EXPECT_EQ(judge(RestingScene(), drift, settings).surround.finding, SurroundFinding::kOff);
}

TEST(Surround, TheCorrectionCanBeUndone) {
  const RestingScene scene;
  const DisplacementField field = scene.seen(RestingScene::drift(10, 0.001, 0.3 * kDegree));
  const Surround surround = assessSurround(field, {});
  ASSERT_TRUE(surround.corrected) << surround.text;
  cv::Mat displacements = field.displacement_pmr.clone();
  takeOut(surround.transform, field.start_pmr, displacements);
  takeOut(surround.transform.inverse(), field.start_pmr, displacements);
  cv::Mat apart = displacements - field.displacement_pmr;
  cv::patchNaNs(apart, 0);
  EXPECT_LT(cv::norm(apart, cv::NORM_INF), 1e-7);
}

/// An ellipse about the middle of the scene's view; the frame's origin is the corner.
Region ellipse(double radius_x, double radius_y) {
  Region outline;
  for (int i = 0; i < 60; ++i)
    outline.emplace_back(0.04 + radius_x * std::cos(2 * M_PI * i / 60), 0.03 + radius_y * std::sin(2 * M_PI * i / 60));
  return outline;
}

void expectCorrected(DisplacementField field, const PairKnowledge& knowledge, const RestingScene& scene,
                     const cv::Mat& opening = {}) {
  const Surround surround = assessSurround(field, knowledge, {}, opening);
  ASSERT_TRUE(surround.corrected) << surround.text;
  takeOut(surround.transform, field.start_pmr, field.displacement_pmr);
  EXPECT_LT(errorsOnBrain(field.displacement_pmr, scene).p95, 0.00025);
}

TEST(Surround, AnOutlineDrawnByHandCountsMoreThanColour) {
  RestingScene scene;
  scene.cover = [](double, double, Matter matter) { return matter == Matter::kDrape ? Matter::kNothing : matter; };
  DisplacementField field = scene.seen(RestingScene::drift(11, 0.001, 0.2 * kDegree));
  field.colour.setTo(cv::Scalar(150, 150, 205));  // all is flesh
  EXPECT_EQ(assessSurround(field, {}).finding, SurroundFinding::kUnseen);
  PairKnowledge knowledge;
  knowledge.brain = {ellipse(0.0285, 0.0225)};
  field.brain = excludedMask(field.frame, knowledge.brain);
  expectCorrected(field, knowledge, scene);
}

TEST(Surround, WhereColourTellsNothingTheProposedOutlineDoes) {
  RestingScene scene;
  scene.cover = [](double, double, Matter matter) { return matter == Matter::kDrape ? Matter::kNothing : matter; };
  DisplacementField field = scene.seen(RestingScene::drift(11, 0.001, 0.2 * kDegree));
  field.colour.setTo(cv::Scalar(150, 150, 150));  // all is as pale as bone
  EXPECT_FALSE(assessSurround(field, {}).corrected);
  field.brain = excludedMask(field.frame, {ellipse(0.0285, 0.0225)});
  expectCorrected(field, {}, scene);
}

// Cotton and instruments are no brain, and no bone either: they move with it.
TEST(Surround, WhatLiesOnTheBrainIsNoBone) {
  RestingScene scene;
  scene.cover = [](double x, double y, Matter matter) {
    return std::hypot(x + 0.004, y) < 0.009 ? Matter::kCotton : matter;
  };
  DisplacementField field = scene.seen(RestingScene::drift(11, 0.001, 0.2 * kDegree));
  const cv::Mat opening = excludedMask(field.frame, {ellipse(0.0285, 0.0225)});
  field.brain = opening.clone();
  const double whole = assessSurround(field, {}).area;
  field.brain.setTo(0, excludedMask(field.frame, {ellipse(0.013, 0.009)}));
  EXPECT_EQ(assessSurround(field, {}, {}, opening).area, whole);
  expectCorrected(field, {}, scene, opening);
}

// The deepest edge in view is that of a cavity packed with cotton: what is around it is flesh, as its wall is.
TEST(Surround, FleshAroundAPackedCavityIsNoBone) {
  RestingScene scene;
  scene.sag = 0;
  scene.cover = [](double x, double y, Matter matter) {
    return std::hypot(x, y) < 0.009 ? Matter::kCotton : matter == Matter::kBrain ? matter : Matter::kNothing;
  };
  scene.movement = [](double, double, Matter matter) {
    return Eigen::Vector3d(0, 0, matter == Matter::kBrain ? 0.0006 : 0);
  };
  DisplacementField field = scene.seen();
  const cv::Mat opening = excludedMask(field.frame, {ellipse(0.013, 0.013)});
  field.brain = opening.clone();
  field.brain.setTo(0, excludedMask(field.frame, {ellipse(0.0095, 0.0095)}));
  const Surround surround = assessSurround(field, {}, {}, opening);
  EXPECT_FALSE(surround.corrected) << surround.text;
  EXPECT_EQ(surround.finding, SurroundFinding::kUnseen) << surround.text;
}

// The deepest edge in view is that of a cavity, and the brain around it rose as one.
TEST(Surround, BrainAroundAHoleIsNoBone) {
  RestingScene scene;
  scene.sag = 0;
  scene.bone = 0.001;
  scene.movement = [](double, double, Matter matter) {
    return Eigen::Vector3d(0, 0, matter == Matter::kBrain ? 0.0006 : 0);
  };
  DisplacementField field = scene.seen();
  field.brain = excludedMask(field.frame, {ellipse(0.008, 0.007)});
  EXPECT_FALSE(assessSurround(field, {}).corrected);
  field.colour.setTo(cv::Scalar(150, 150, 150));
  const Surround grey = assessSurround(field, {});
  EXPECT_FALSE(grey.corrected);
  EXPECT_THAT(grey.text, testing::HasSubstr("colour does not tell bone from brain here"));
}

}  // namespace
}  // namespace cortshift_tracking
