#include "cortshift_tracking/surround/outline.hpp"

#include <gmock/gmock.h>

#include <opencv2/imgproc.hpp>

namespace cortshift_tracking {
namespace {

using testing::HasSubstr;

constexpr double kResolution = 0.0002;  // [m]

/// 80 x 60 mm: brain in an oval of 56 x 44 mm with a cuff of dura, bone and drape around it, in a light of these gains
/// of blue, green and red.
struct Painted {
  Projection projection;
  cv::Mat brain;
};

Painted painted(const cv::Scalar& gains, const cv::Scalar& tissue = {0.45, 0.45, 0.80}, double bone = 0.0085) {
  Painted out;
  const cv::Size size(400, 300);
  cv::Mat colour(size, CV_32FC3, cv::Scalar(0.52, 0.40, 0.16));
  const auto oval = [&](double wider, const cv::Scalar& with) {
    const cv::Size axes(cvRound((0.028 + wider) / kResolution), cvRound((0.022 + wider) / kResolution));
    cv::ellipse(colour, {200, 150}, axes, 0, 0, 360, with, cv::FILLED);
  };
  if (bone > 0) oval(bone, {0.62, 0.74, 0.80});
  oval(0.0022, {0.62, 0.66, 0.80});
  oval(0, tissue);
  out.brain = cv::Mat::zeros(size, CV_8UC1);
  cv::ellipse(out.brain, {200, 150}, {140, 110}, 0, 0, 360, 255, cv::FILLED);
  cv::multiply(colour, gains, colour);
  cv::Mat noise(size, CV_32FC3);
  cv::RNG(3).fill(noise, cv::RNG::NORMAL, 0, 0.01);
  colour += noise;
  out.projection.resolution = kResolution;
  out.projection.colour = colour;
  out.projection.mask = cv::Mat(size, CV_8UC1, cv::Scalar(255));
  return out;
}

double overlapOf(const cv::Mat& said, const cv::Mat& truth) {
  return static_cast<double>(cv::countNonZero(said & truth)) / cv::countNonZero(said | truth);
}

TEST(Outline, IsThatOfTheBrainInLightThatIsNearlyWhite) {
  for (const cv::Scalar& gains : {cv::Scalar(1, 1, 1), cv::Scalar(1.04, 1, 0.94), cv::Scalar(1.1, 1, 0.9)}) {
    const Painted scene = painted(gains);
    const Outline outline = proposeOutline(scene.projection);
    ASSERT_FALSE(outline.brain.empty()) << outline.text;
    EXPECT_GT(overlapOf(outline.brain, scene.brain), 0.93);
  }
}

TEST(Outline, IsRightOrNotKnownInTintedLight) {
  // Warm and wrongly balanced light makes bone as red as brain: what was proposed held the bone too.
  const cv::Scalar warm[] = {{0.6, 0.85, 1.15}, {0.8, 1.0, 1.2}, {0.7, 0.9, 1.15}, {0.8, 0.9, 1.1}};
  for (const cv::Scalar& gains : warm) {
    const Painted scene = painted(gains);
    const Outline outline = proposeOutline(scene.projection);
    EXPECT_TRUE(outline.brain.empty()) << gains << overlapOf(outline.brain, scene.brain);
    EXPECT_THAT(outline.text, HasSubstr("not known: "));
  }
  for (const cv::Scalar& gains : {cv::Scalar(0.85, 1.15, 0.8), cv::Scalar(1.25, 1, 0.75), cv::Scalar(0.9, 1.1, 0.9)}) {
    const Painted scene = painted(gains);
    const Outline outline = proposeOutline(scene.projection);
    if (outline.brain.empty())
      EXPECT_THAT(outline.text, HasSubstr("not known: "));
    else
      EXPECT_GT(overlapOf(outline.brain, scene.brain), 0.93) << gains;
  }
}

TEST(Outline, WithoutBoneNothingTellsTheColourOfTheLight) {
  EXPECT_THAT(proposeOutline(painted({1, 1, 1}, {0.45, 0.45, 0.80}, 0).projection).text,
              HasSubstr("too little bone is in view"));
}

TEST(Outline, BrainThatLooksLikeBoneIsNotKnown) {
  const Outline outline = proposeOutline(painted({1, 1, 1}, {0.62, 0.70, 0.84}).projection);
  EXPECT_TRUE(outline.brain.empty());
  EXPECT_THAT(outline.text, HasSubstr("not known: "));
}

}  // namespace
}  // namespace cortshift_tracking
