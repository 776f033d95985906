// What the evidence says of a flow whose error is known, and what the fitted weights make of it.
#include "trust/judgement.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "trust/evidence.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(160, 120);
constexpr float kNoise = 1 / 255.f;

/// Texture that moves by (shift, 0), and a flow that says (told, 0), everywhere confirmed by its surroundings.
struct Scene {
  Scene(float shift, float told) {
    images.first.create(kSize);
    cv::Mat4f second(kSize);
    for (int y = 0; y < kSize.height; ++y)
      for (int x = 0; x < kSize.width; ++x) {
        images.first(y, x) = colour(static_cast<float>(x), static_cast<float>(y));
        second(y, x) = colour(static_cast<float>(x) - shift, static_cast<float>(y));
      }
    images.second = splineCoefficients(second, 1);
    flow = {Plane(kSize, told), Plane(kSize)};
    backward = {Plane(kSize, -told), Plane(kSize)};
    other = flow;
  }

  static cv::Vec4f colour(float x, float y) {
    const float value = 0.5f + 0.1f * std::sin(0.5f * x + 0.2f * y) + 0.1f * std::sin(0.45f * y - 0.15f * x);
    return {value, value, value, 0};
  }

  cv::Mat evidence() const {
    const cv::Vec4f weights(1 / (kNoise * kNoise), 1 / (kNoise * kNoise), 1 / (kNoise * kNoise), 0);
    return gatherEvidence({images, weights, flow, backward, other, sound, fit_error}, 1);
  }

  float cue(Cue which) const {
    return std::exp(evidence().ptr<float>(kSize.height / 8)[kSize.width / 8 * kCues + which]);
  }

  ImagePair images;
  FlowPlanes flow, backward, other;
  cv::Mat1b sound{cv::Mat1b(kSize, uchar{1})};
  cv::Mat1f fit_error{cv::Mat1f(kSize, 0.02f)};
};

TEST(Evidence, AStepMeasuresTheErrorOfASmoothFlow) {
  for (const float off : {0.1f, 0.3f, 0.6f}) {
    const Scene scene(2, 2 - off);
    EXPECT_NEAR(scene.cue(kNearStep), off, 0.15f * off);
    EXPECT_NEAR(scene.cue(kWideStep), off, 0.15f * off);
    EXPECT_NEAR(scene.cue(kStepsAround), off, 0.15f * off);
  }
  EXPECT_LT(Scene(2, 2).cue(kNearStep), 0.01f);
}

TEST(Evidence, TheWayBackShowsWhereTheTwoDirectionsDisagree) {
  Scene scene(2, 2);
  scene.backward.u = Plane(kSize, -1.5f);
  EXPECT_NEAR(scene.cue(kReturn), 0.5f, 1e-3);
  scene.backward = {Plane(kSize / 2, -0.75f), Plane(kSize / 2)};  // the same, of half the size
  EXPECT_NEAR(scene.cue(kReturn), 0.5f, 1e-3);
}

TEST(Evidence, HiddenAndBrokenWindowsAreCounted) {
  Scene scene(2, 2);
  EXPECT_NEAR(std::log(scene.cue(kHidden)), 0, 1e-4);
  scene.sound.setTo(0);
  EXPECT_NEAR(std::log(scene.cue(kHidden)), 1, 1e-3);
}

TEST(Judgement, AFlowThatIsWrongIsKnownToBe) {
  for (const FitKind kind : {FitKind::kSmooth, FitKind::kPiecewise, FitKind::kSmoothOfTwo}) {
    const auto errorOf = [&](const Scene& scene) {
      return judgedError(scene.evidence(), kind, scene.fit_error, 1)(kSize.height / 2, kSize.width / 2);
    };
    EXPECT_LT(errorOf(Scene(2, 2)), 0.1f);
    Scene wrong(2, 0.8f);  // the fit itself thinks that it is right, and the models disagree about it
    wrong.backward.u = Plane(kSize, -2);
    wrong.other.u = Plane(kSize, 2);
    EXPECT_GT(errorOf(wrong), 3 * errorOf(Scene(2, 2)));
  }
}

TEST(Judgement, OnlyAStepAboveItsNoiseCallsForAnotherModel) {
  const auto share = [](const Scene& scene, float error) {
    return shareContradicted(scene.evidence(), cv::Mat1f(kSize, error));
  };
  EXPECT_GT(share(Scene(2, 1.4f), 0.5f), 0.9);
  EXPECT_EQ(share(Scene(2, 1.4f), 0.25f), 0);  // off, but believed: a confidence of one half is
  EXPECT_EQ(share(Scene(2, 2), 0.5f), 0);      // unsure, but the images ask for nothing else
  Scene hidden(2, 1.4f);
  hidden.sound.setTo(0);
  EXPECT_EQ(share(hidden, 0.5f), 0);
  EXPECT_EQ(share(Scene(2, 1.4f), std::numeric_limits<float>::infinity()), 0);
}

TEST(Judgement, IsInfiniteWhereTheMaskExcludes) {
  Scene scene(2, 2);
  scene.fit_error(10, 20) = std::numeric_limits<float>::infinity();
  const cv::Mat1f error = judgedError(scene.evidence(), FitKind::kSmooth, scene.fit_error, 1);
  EXPECT_TRUE(std::isinf(error(10, 20)));
  EXPECT_TRUE(std::isfinite(error(10, 21)));
}

}  // namespace
}  // namespace cortshift_flow
