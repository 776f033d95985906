#include "cortshift_tracking/surround/outline.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace cortshift_tracking {
namespace {

using testing::HasSubstr;

constexpr double kResolution = 0.0002;  // [m]

/// 80 x 60 mm: brain in an oval of 56 x 44 mm, with a cuff of dura, bone that stands up, and drape around it.
struct Head {
  cv::Scalar tissue{0.45, 0.45, 0.80}, light{1, 1, 1};  ///< blue, green, red
  double texture = 0;                                   ///< grey pebbles of this contrast on the brain
  double bone = 0.003;                                  ///< [m] that it stands above the brain
  double bulge = 0;                                     ///< [m] of the brain in its middle
};

struct Painted {
  Projection projection;
  cv::Mat brain;
};

/// Of the oval, 0 on it, about [m]; positive outside.
double outside(double x, double y) { return (std::hypot(x / 0.028, y / 0.022) - 1) * 0.025; }

Painted painted(const Head& head) {
  Painted out;
  const cv::Size size(400, 300);
  out.projection.resolution = kResolution;
  out.projection.colour = cv::Mat(size, CV_32FC3);
  out.projection.height = cv::Mat(size, CV_32FC1);
  out.projection.mask = cv::Mat(size, CV_8UC1, cv::Scalar(255));
  out.brain = cv::Mat::zeros(size, CV_8UC1);
  cv::RNG random(3);
  cv::Mat pebbles(size, CV_32FC1);
  random.fill(pebbles, cv::RNG::NORMAL, 0, 1);
  cv::GaussianBlur(pebbles, pebbles, cv::Size(), 3);
  pebbles *= 10.6;  // unit variance again
  for (int row = 0; row < size.height; ++row)
    for (int column = 0; column < size.width; ++column) {
      const double x = (column - 200) * kResolution, y = (row - 150) * kResolution, edge = outside(x, y);
      cv::Scalar colour = head.tissue * (1 + head.texture * static_cast<double>(pebbles.at<float>(row, column)));
      if (edge > 0) colour = {0.62, 0.66, 0.80};
      if (edge > 0.0022) colour = {0.62, 0.74, 0.80};
      if (edge > 0.0085) colour = {0.52, 0.40, 0.16};
      for (int i = 0; i < 3; ++i)
        out.projection.colour.at<cv::Vec3f>(row, column)[i] =
            static_cast<float>(colour[i] * head.light[i] + random.gaussian(0.01));
      const double rise = std::min(1.0, std::max(0.0, edge / 0.004)), inside = std::max(0.0, -edge / 0.025);
      out.projection.height.at<float>(row, column) =
          static_cast<float>(head.bone * rise * rise * (3 - 2 * rise) + head.bulge * inside * (2 - inside) -
                             (x * x + y * y) / 0.16 + random.gaussian(0.00003));
      out.brain.at<uchar>(row, column) = edge < 0 ? 255 : 0;
    }
  return out;
}

double overlapOf(const cv::Mat& said, const cv::Mat& truth) {
  return static_cast<double>(cv::countNonZero(said & truth)) / cv::countNonZero(said | truth);
}

void expectKnown(const Head& head) {
  const Painted scene = painted(head);
  const Outline outline = proposeOutline(scene.projection);
  ASSERT_FALSE(outline.brain.empty()) << outline.text;
  EXPECT_GT(overlapOf(outline.brain, scene.brain), 0.93);
}

void expectNotKnown(const Projection& projection, const std::string& why) {
  const Outline outline = proposeOutline(projection);
  EXPECT_TRUE(outline.brain.empty());
  EXPECT_THAT(outline.text, HasSubstr("not known: "));
  EXPECT_THAT(outline.text, HasSubstr(why));
}

void paint(Painted& scene, const cv::Point& centre, const cv::Size& axes, const cv::Scalar& colour) {
  cv::ellipse(scene.projection.colour, centre, axes, 0, 0, 360, colour, cv::FILLED);
}

TEST(Outline, IsThatOfTheBrainInAnyLight) {
  Head head;
  for (const cv::Scalar& light : {cv::Scalar(1, 1, 1), cv::Scalar(0.6, 0.85, 1.15), cv::Scalar(1.25, 1, 0.75),
                                  cv::Scalar(0.85, 1.15, 0.8), cv::Scalar(0.8, 1.0, 1.2)}) {
    head.light = light;
    expectKnown(head);
  }
}

TEST(Outline, IsThatOfGreyTissueToo) {
  Head head;
  head.tissue = {0.4, 0.4, 0.4};
  head.texture = 0.3;
  expectKnown(head);
}

TEST(Outline, IsThatOfABrainThatBulgesToTheHeightOfBone) {
  Head head;
  head.bulge = head.bone = 0.004;
  expectKnown(head);
}

TEST(Outline, BloodOverTheRimDoesNotBendIt) {
  Painted scene = painted({});
  paint(scene, {330, 190}, {35, 25}, {0.055, 0.045, 0.30});
  const Outline outline = proposeOutline(scene.projection);
  ASSERT_FALSE(outline.brain.empty()) << outline.text;
  EXPECT_GT(overlapOf(outline.brain, scene.brain), 0.93);
}

// Beside the step of bone colours say where the brain ends: a film that narrows it by less than 3 mm is followed, and
// a wider one where it has the paleness of bone (a flap of dura), not of blood.
TEST(Outline, FollowsColoursInsideTheStep) {
  const cv::Scalar dura(0.62, 0.66, 0.80), blood(0.055, 0.045, 0.30);
  const Painted clean = painted({});
  const Outline whole = proposeOutline(clean.projection);
  ASSERT_FALSE(whole.brain.empty()) << whole.text;
  const auto followed = [&](double width, const cv::Scalar& colour) {
    Painted scene = painted({});
    cv::Mat film = cv::Mat::zeros(scene.brain.size(), CV_8UC1);
    for (int row = 115; row < 185; ++row)
      for (int column = 0; column < 400; ++column) {
        const double edge = outside((column - 200) * kResolution, (row - 150) * kResolution);
        if (column > 200 && edge > -width && edge < 0.003) film.at<uchar>(row, column) = 255;
      }
    scene.projection.colour.setTo(colour, film);
    const Outline narrowed = proposeOutline(scene.projection);
    EXPECT_FALSE(narrowed.brain.empty()) << narrowed.text;
    const auto endOf = [](const cv::Mat& brain) {
      return cv::countNonZero(brain(cv::Rect(200, 150, 200, 1))) * kResolution;
    };
    return narrowed.brain.empty() ? 0 : endOf(whole.brain) - endOf(narrowed.brain);
  };
  for (const double width : {0.0015, 0.0025, 0.0045}) EXPECT_NEAR(followed(width, dura), width, 0.0007) << width;
  EXPECT_NEAR(followed(0.0025, blood), 0.0025, 0.0007);
  EXPECT_LT(followed(0.0045, blood), 0.0035);
}

TEST(Outline, ABladeAcrossTheRimIsNoBrain) {
  Painted scene = painted({});
  cv::Mat blade = cv::Mat::zeros(scene.brain.size(), CV_8UC1);
  cv::rectangle(blade, cv::Rect(240, 130, 160, 40), 255, cv::FILLED);
  scene.projection.colour.setTo(cv::Scalar::all(0.5), blade);
  scene.projection.height.setTo(0.008, blade);
  scene.brain.setTo(0, blade);
  const Outline outline = proposeOutline(scene.projection);
  ASSERT_FALSE(outline.brain.empty()) << outline.text;
  EXPECT_GT(overlapOf(outline.brain, scene.brain), 0.93);
}

const cv::Point kPad(180, 140);
const cv::Size kPadAxes(45, 35);  // 9 by 7 mm

cv::Mat padOf(const Painted& scene) {
  cv::Mat pad = cv::Mat::zeros(scene.brain.size(), CV_8UC1);
  cv::ellipse(pad, kPad, kPadAxes, 0, 0, 360, 255, cv::FILLED);
  return pad;
}

// Half of it is brighter than the cameras can see, so that there is no surface.
TEST(Outline, CottonThatLiesFlatOnTheBrainIsNoneInAnyLight) {
  for (const cv::Scalar& light : {cv::Scalar(1, 1, 1), cv::Scalar(0.6, 0.85, 1.1), cv::Scalar(1.05, 1, 0.75)}) {
    Head head;
    head.light = light;
    Painted scene = painted(head);
    const cv::Mat pad = padOf(scene);
    scene.projection.colour.setTo(cv::Scalar(0.9, 0.88, 0.86).mul(light), pad);
    cv::RNG random(5);
    for (int i = 0; i < 700; ++i) {
      const cv::Point hole(random.uniform(135, 225), random.uniform(105, 175));
      if (pad.at<uchar>(hole) == 0) continue;
      cv::circle(scene.projection.mask, hole, 1, 0, cv::FILLED);
      cv::circle(scene.projection.colour, hole, 1, cv::Scalar::all(0), cv::FILLED);
      cv::circle(scene.projection.height, hole, 1, cv::Scalar::all(std::numeric_limits<float>::quiet_NaN()),
                 cv::FILLED);
    }
    const Outline outline = proposeOutline(scene.projection);
    ASSERT_FALSE(outline.brain.empty()) << outline.text;
    const double left = cv::countNonZero(outline.brain & pad) / static_cast<double>(cv::countNonZero(pad));
    EXPECT_LT(left, 0.05);
    EXPECT_GT(overlapOf(outline.brain, scene.brain & ~pad), 0.93);
    const cv::Mat seen = pad & scene.projection.mask;
    EXPECT_GT(cv::countNonZero(outline.opening & seen), 0.95 * cv::countNonZero(seen));  // of the craniotomy it is
  }
}

TEST(Outline, PalenessThatFadesIsBrain) {
  Painted scene = painted({});
  for (int row = 0; row < 300; ++row)
    for (int column = 0; column < 400; ++column) {
      if (scene.brain.at<uchar>(row, column) == 0) continue;
      const double away = std::hypot(column - kPad.x, row - kPad.y) / 30;
      cv::Vec3f& colour = scene.projection.colour.at<cv::Vec3f>(row, column);
      const auto share = static_cast<float>(std::exp(-away * away));
      colour = share * cv::Vec3f(0.7F, 0.75F, 0.8F) + (1 - share) * colour;
    }
  const Outline outline = proposeOutline(scene.projection);
  ASSERT_FALSE(outline.brain.empty()) << outline.text;
  EXPECT_NE(outline.brain.at<uchar>(kPad), 0);
}

TEST(Outline, CottonOnGreyTissueIsNotTold) {
  Head head;
  head.tissue = {0.4, 0.4, 0.4};
  head.texture = 0.3;
  Painted scene = painted(head);
  scene.projection.colour.setTo(cv::Scalar(0.9, 0.88, 0.86), padOf(scene));
  const Outline outline = proposeOutline(scene.projection);
  ASSERT_FALSE(outline.brain.empty()) << outline.text;
  EXPECT_NE(outline.brain.at<uchar>(kPad), 0);
}

TEST(Outline, WhatIsLessThanALimitIsNotKnown) {
  const OutlineLimits limits;
  const FoundOutline enough{{}, {}, limits.seen, limits.stepped, limits.clear, limits.together};
  EXPECT_EQ(doubtOf(enough), "");
  const std::pair<double FoundOutline::*, const char*> shares[] = {
      {&FoundOutline::seen, "an edge of the craniotomy is in view on only 50 %"},
      {&FoundOutline::stepped, "bone stands up around the brain on only 50 %"},
      {&FoundOutline::clear, "colours differ at the edge of bone on only 50 %"},
      {&FoundOutline::together, "relief and colours agree on an edge on only 50 %"}};
  for (const auto& [share, text] : shares) {
    FoundOutline found = enough;
    found.*share = 0.5;
    EXPECT_THAT(doubtOf(found), HasSubstr(text));
  }
}

TEST(Outline, CottonOverMostOfTheBrainIsNotTold) {
  Painted scene = painted({});
  cv::Mat pad = cv::Mat::zeros(scene.brain.size(), CV_8UC1);
  cv::ellipse(pad, {200, 150}, {110, 90}, 0, 0, 360, 255, cv::FILLED);
  scene.projection.colour.setTo(cv::Scalar(0.9, 0.88, 0.86), pad);
  const Outline outline = proposeOutline(scene.projection);
  ASSERT_FALSE(outline.brain.empty()) << outline.text;
  EXPECT_NE(outline.brain.at<uchar>(150, 200), 0);
}

TEST(Outline, WithoutAStepNothingSaysWhereBoneBegins) {
  Head head;
  head.bone = 0;
  expectNotKnown(painted(head).projection, "of the way around");
}

TEST(Outline, AStepAsLowAsDuraIsNotBone) {
  Head head;
  head.bone = 0.0006;
  expectNotKnown(painted(head).projection, "bone stands up around the brain on only");
}

TEST(Outline, AnEdgeThatColoursDoNotShowIsNotKnown) {
  Head head;
  head.tissue = {0.62, 0.66, 0.80};  // dura's: what is seen is the edge of dura on bone, elsewhere
  expectNotKnown(painted(head).projection, "relief and colours agree on an edge on only");
  Painted covered = painted(head);
  covered.projection.colour.setTo(cv::Scalar(0.055, 0.045, 0.30));  // all in blood
  expectNotKnown(covered.projection, "colours differ at the edge of bone on only");
}

TEST(Outline, ARimThatIsHalfInViewIsNotKnown) {
  Painted scene = painted({});
  const cv::Rect part(0, 0, 200, 300);
  for (cv::Mat* picture : {&scene.projection.colour, &scene.projection.height, &scene.projection.mask})
    *picture = (*picture)(part).clone();
  expectNotKnown(scene.projection, "of the way around");
}

TEST(Outline, ATinyOrEmptyViewIsNotKnown) {
  Painted scene = painted({});
  scene.projection.mask.setTo(0);
  scene.projection.colour.setTo(0);
  scene.projection.height.setTo(std::numeric_limits<float>::quiet_NaN());
  expectNotKnown(scene.projection, "too small");
}

}  // namespace
}  // namespace cortshift_tracking
