// What the predicted error is made of, on planes whose every number is known.
#include "trust/confidence.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "cortshift_flow/flow.hpp"
#include "polish/spline_grid.hpp"

namespace cortshift_flow {
namespace {

constexpr float kCurvature = 0.004f, kSuspect = 0.02f, kInformation = 1e6f;
const cv::Size kSize(64, 48);

/// Still tissue, alike in both images, perfectly known.
struct Scene {
  Scene() {
    level.first = cv::Mat4f(kSize, cv::Vec4f(0.4f, 0.5f, 0.6f, 0));
    level.second = level.first.clone();
    visible = cv::Mat1b(kSize, uchar{1});
    flow.u.create(kSize.height, kSize.width);
    flow.v.create(kSize.height, kSize.width);
    const cv::Size nodes = SplineGrid::nodes(kSize);
    polished.nodes.u.create(nodes.height, nodes.width);
    polished.nodes.v.create(nodes.height, nodes.width);
    polished.information.create(nodes.height, nodes.width, kInformation);
    polished.regular = cv::Mat1b(nodes, uchar{1});
  }
  float errorAt(int x, int y) const {
    return predictError(level, flow, visible, polished, kCurvature, kSuspect, 1)(y, x);
  }

  Level level;
  FlowPlanes flow;
  cv::Mat1b visible;
  PolishedFlow polished;
};

TEST(PredictedError, OfStillTissueIsTheNoisesAlone) {
  // The posterior of a thin plate: a variance of c / (pi sqrt(J)); a hundredth of a pixel is always there.
  const double noise = std::sqrt(kCurvature / (M_PI * std::sqrt(kInformation - 45.0)));
  EXPECT_NEAR(Scene().errorAt(30, 20), 0.01 + noise, 1e-5);
}

TEST(PredictedError, FallsWithTheFourthRootOfTheInformation) {
  Scene well, poorly;
  poorly.polished.information.create(well.polished.information.height(), well.polished.information.width(), 1e4f);
  EXPECT_NEAR((poorly.errorAt(30, 20) - 0.01) / (well.errorAt(30, 20) - 0.01), std::sqrt(10.0), 0.01);
}

TEST(PredictedError, GrowsWithTheDistanceFromWhatIsVisible) {
  Scene scene;
  scene.visible.colRange(0, 20).setTo(0);
  EXPECT_NEAR(scene.errorAt(10, 20) - scene.errorAt(30, 20), 0.021 * 10, 0.02);
}

TEST(PredictedError, IsAPixelWhereTheImagesDoNotLookAlike) {
  // Mismatch is summed over three channels; windows that differ by more than 0.065 do not show the same tissue.
  const auto darkerBy = [](float mismatch) {
    Scene scene;
    scene.level.second -= cv::Scalar::all(mismatch / 3);
    return scene.errorAt(30, 20);
  };
  EXPECT_LT(darkerBy(0.060f), 0.1f);
  EXPECT_GE(darkerBy(0.070f), 1.f);
  Scene hidden;  // of what is not visible nothing can be seen to differ
  hidden.level.second -= cv::Scalar::all(0.03);
  hidden.visible(20, 30) = 0;
  EXPECT_LT(hidden.errorAt(30, 20), 0.1f);
}

TEST(PredictedError, IsAPixelAtAMotionBoundary) {
  Scene scene;
  scene.polished.regular(20 / SplineGrid::kSpacing, 32 / SplineGrid::kSpacing) = 0;
  EXPECT_GE(scene.errorAt(32, 20), 1.f);
  EXPECT_GE(scene.errorAt(35, 23), 1.f);
  EXPECT_LT(scene.errorAt(36, 20), 0.1f);
  EXPECT_LT(scene.errorAt(31, 20), 0.1f);
}

TEST(PredictedError, GrowsWithTheBendOfTheFlow) {
  const auto bentBy = [](float second_difference) {
    Scene scene;
    for (int j = 0; j < scene.polished.nodes.u.height(); ++j)
      for (int i = 0; i < scene.polished.nodes.u.width(); ++i)
        scene.polished.nodes.u.row(j)[i] = 0.5f * second_difference * static_cast<float>(i * i);
    return scene.errorAt(30, 20) - Scene().errorAt(30, 20);
  };
  EXPECT_GT(bentBy(0.1f), 0.01f);
  EXPECT_NEAR(bentBy(0.4f), 2.5 * 0.4 * 0.4, 0.05);  // of a bend within a node's spacing, 2.5 of its square
}

TEST(PredictedError, IsInfiniteOutsideTheMask) {
  Scene scene;
  scene.level.first_valid = cv::Mat1b(kSize, uchar{1});
  scene.level.first_valid(20, 30) = 0;
  EXPECT_TRUE(std::isinf(scene.errorAt(30, 20)));
  EXPECT_FALSE(std::isinf(scene.errorAt(31, 20)));
}

TEST(Confidence, IsAHalfAtAQuarterOfAPixelAndCanBeReadBack) {
  const cv::Mat1f error(kSize / 2, 0.125f);  // of the half level: a quarter of a pixel of the image
  const cv::Mat1f confidence = confidenceFromError(error, 1, kSize, 1);
  EXPECT_FLOAT_EQ(confidence(20, 30), 0.5f);
  EXPECT_EQ(confidence.size(), kSize);
  for (const float e : {0.05f, 0.25f, 1.f})
    EXPECT_NEAR(predictedError(confidenceFromError(cv::Mat1f(1, 1, e), 0, {1, 1}, 1)(0, 0)), e, 1e-5);
  EXPECT_TRUE(std::isinf(predictedError(0)));
}

}  // namespace
}  // namespace cortshift_flow
