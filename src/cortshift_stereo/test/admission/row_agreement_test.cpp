// The rows of a pair as a motion of the right camera: found, taken out, or refused, with its value.
#include "cortshift_stereo/admission/row_agreement.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/calib3d.hpp>

#include "analytic_scene.hpp"
#include "cortshift_stereo/admission/pair_quality.hpp"
#include "cortshift_stereo/reconstruction.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_test::AnalyticScene;

/// The model of a scene whose right camera is taken to stand otherwise than it does.
StereoModel withWrongRight(const AnalyticScene& scene, const cv::Vec3d& turn) {
  StereoModel model = scene.model();
  cv::Matx33d rotation;
  cv::Rodrigues(turn, rotation);
  model.right.R = rotation * model.right.R;
  return model;
}

double medianError(const AnalyticScene& scene, const cv::Mat& disparity) {
  const StereoModel model = scene.model();
  const cv::Mat depth = scene.trueDepth();
  std::vector<double> errors;
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x)
      if (const float d = disparity.at<float>(y, x); !std::isnan(d))
        errors.push_back(std::abs(depthOfDisparity(model, d) - depth.at<float>(y, x)));
  std::sort(errors.begin(), errors.end());
  return errors.empty() ? 1e9 : errors[errors.size() / 2];
}

TEST(RowAgreement, pointsOfAKnownMotionGiveItBackWithItsError) {
  const AnalyticScene scene;
  const Rectifier rectifier(scene.model());
  const cv::Matx34d& P = rectifier.model().right.P;
  const double f = P(1, 1), wx = 0.0011, wy = 0.004, wz = -0.0016, s = 0.0004, sd = 0.1;
  cv::RNG random(3);
  int within = 0;
  double spreads = 0;
  constexpr int kTrials = 60;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<MatchedPoint> points;
    for (int i = 0; i < 400; ++i) {
      const cv::Point2d right(random.uniform(0.0, 320.0), random.uniform(0.0, 240.0));
      const double u = (right.x - P(0, 2)) / P(0, 0), v = (right.y - P(1, 2)) / f;
      double gap = f * (-wx * (1 + v * v) + wy * u * v + wz * u + s * v) + random.gaussian(sd);
      if (i % 10 == 0) gap += random.uniform(-8.0, 8.0);  // a tenth is matched wrongly
      points.push_back({{right.x + 3, right.y - gap}, right, sd});
    }
    const RowAgreement rows = agreementOf(points, rectifier);
    EXPECT_NEAR(rows.turn_x.value, wx, 5 * rows.turn_x.sd);
    EXPECT_NEAR(rows.turn_z.value, wz, 5 * rows.turn_z.sd);
    EXPECT_NEAR(rows.turn_y.value, wy, 5 * rows.turn_y.sd);
    EXPECT_NEAR(rows.scale.value, s, 5 * rows.scale.sd);
    spreads += rows.spread;
    within += std::abs(rows.turn_z.value - wz) < rows.turn_z.sd;
  }
  // With a tenth matched wrongly the median of normal sizes is their quantile 0.5 / 0.9: 1.135 deviations, so that
  // sqrt(1.135^2 - 1) sd seems to be left.
  EXPECT_NEAR(spreads / kTrials, 0.054, 0.01);
  EXPECT_NEAR(within, 0.683 * kTrials, 0.2 * kTrials) << "a standard error holds two of three";
}

TEST(RowAgreement, aTurnedCameraIsFoundTakenOutAndSaid) {
  const AnalyticScene scene;
  const cv::Vec3d turn(0.0016, 0, -0.0022);  // rows off by 1.9 px and, at the sides, 0.3 px
  const ReconstructionResult result = reconstruct(scene.left(), scene.right(), Rectifier(withWrongRight(scene, turn)));
  EXPECT_LT(medianError(scene, result.disparity), 0.0001) << "0.03 px, as without a turn";
  ASSERT_EQ(result.warnings.size(), 1u);
  const std::string& warning = result.warnings.front();
  for (const char* part : {"The right camera is turned by 0.15", "about the horizontal axis", "about the optical axis",
                           "makes depths wrong by 9.", " mm", "calibrate again"})
    EXPECT_NE(warning.find(part), std::string::npos) << part << " in: " << warning;
  EXPECT_LT(result.quality.epipolar.misalignment.value, 0.1) << "what is left";
}

TEST(RowAgreement, aPairThatAgreesHasNoWarning) {
  const AnalyticScene scene;
  const ReconstructionResult result = reconstruct(scene.left(), scene.right(), Rectifier(scene.model()));
  EXPECT_TRUE(result.warnings.empty()) << result.warnings.front();
  EXPECT_LT(result.quality.epipolar.misalignment.value, 0.1);
}

TEST(RowAgreement, aLargeTurnIsRefusedWithItsValue) {
  const AnalyticScene scene;
  try {
    reconstruct(scene.left(), scene.right(), Rectifier(withWrongRight(scene, {0.004, 0, 0})));  // 4.8 px
    FAIL();
  } catch (const PairError& error) {
    EXPECT_EQ(error.reason(), "epipolar");
    EXPECT_NE(std::string(error.what()).find("turned by 0.2"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("rows off by 4."), std::string::npos) << error.what();
  }
}

TEST(RowAgreement, chanceAloneRefusesNothing) {
  RowAgreement rows;
  rows.matched = 100;
  rows.misalignment = {4.0, 0.5};  // beyond the limit of 3 px by two standard errors
  EXPECT_EQ(judgeRows(rows, {}).findings.refusal(), nullptr);
  rows.misalignment.sd = 0.1;
  ASSERT_NE(judgeRows(rows, {}).findings.refusal(), nullptr);
  EXPECT_EQ(judgeRows(rows, {}).findings.refusal()->check, CheckId::kEpipolar);
}

TEST(RowAgreement, aTurnedRectifierSeesWhatATurnedModelWould) {
  const AnalyticScene scene;
  const cv::Vec3d turn(0.002, 0.001, -0.003);
  const Rectifier turned = Rectifier(withWrongRight(scene, turn)).withRightTurned(turn);
  const Rectifier truth(scene.model());
  EXPECT_LT(cv::norm(cv::Mat(turned.model().right.R), cv::Mat(truth.model().right.R), cv::NORM_INF), 1e-9);
  const cv::Rect inner(20, 20, 280, 200);
  EXPECT_LT(cv::norm(turned.rightMap()(inner), truth.rightMap()(inner), cv::NORM_INF), 2e-3);
}

TEST(RowAgreement, oneImageBlurredAgainstTheOtherIsRefusedByItsSide) {
  AnalyticScene scene;
  const cv::Mat left = scene.left();
  scene.blur = 6;
  ReconstructionSettings settings;
  settings.limits.min_sharpness = 0;  // which would see it by itself
  settings.limits.max_sharpness_ratio =
      2;  // this scene has as much detail of 2-4 px as of 8-16: blurred it keeps 1 / 2.4
  try {
    reconstruct(left, scene.right(), Rectifier(scene.model()), settings);
    FAIL();
  } catch (const PairError& error) {
    EXPECT_EQ(error.reason(), "defocused");
    EXPECT_NE(std::string(error.what()).find("The right image is blurred against the other one"), std::string::npos)
        << error.what();
  }
  EXPECT_THROW(reconstruct(left, scene.right(), Rectifier(scene.model())), PairError);
}

}  // namespace
}  // namespace cortshift_stereo
