// The mix of colours makes unequal cameras alike and leaves out what is noise or full.
#include "rectification/colour_mix.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <opencv2/core.hpp>

namespace cortshift_stereo {
namespace {

/// Tissue of three colours that vary together, seen by two cameras.
struct Tissue {
  cv::Vec3d noise{1.5, 1.5, 1.5};  // [grey levels] of each camera
  std::function<cv::Vec3f(const cv::Vec3f&)> right = [](const cv::Vec3f& colour) { return colour; };
  std::function<cv::Vec3f(const cv::Vec3f&)> both = [](const cv::Vec3f& colour) { return colour; };

  std::vector<ColourPair> pairs(int count = 4000) const {
    cv::RNG random(5);
    const auto noisy = [&](const cv::Vec3f& colour) {
      cv::Vec3f out;
      for (int c = 0; c < 3; ++c) out[c] = colour[c] + static_cast<float>(random.gaussian(noise[c]));
      return out;
    };
    std::vector<ColourPair> out;
    for (int i = 0; i < count; ++i) {
      const auto shade = static_cast<float>(random.gaussian(25)), change = static_cast<float>(random.gaussian(8));
      const cv::Vec3f base(110, 125, 160), tint(0.9f, 1.0f, 0.8f);
      const cv::Vec3f before = both(base + (shade - change / 2) * tint),
                      behind = both(base + (shade + change / 2) * tint);
      const cv::Vec3f l0 = noisy(before), l1 = noisy(behind), r0 = right(noisy(before)), r1 = right(noisy(behind));
      out.push_back({{i % 64 * 16, i / 64 * 12}, 0.5f * (l0 + l1), 0.5f * (r0 + r1), l1 - l0, r1 - r0});
    }
    return out;
  }
};

TEST(ColourMix, IsTheMeanWhereCamerasAndColoursAreAlike) {
  const ColourMix mix = chooseMix(Tissue().pairs());
  for (int c = 0; c < 3; ++c) {
    EXPECT_FLOAT_EQ(mix.left[c], 1.0f / 3);
    EXPECT_NEAR(mix.right[c], 1.0f / 3, 0.005);
  }
}

TEST(ColourMix, MakesUnequalCamerasAlike) {
  Tissue tissue;
  tissue.right = [](const cv::Vec3f& colour) { return colour.mul(cv::Vec3f(0.8f, 0.9f, 1.1f)); };
  const ColourMix mix = chooseMix(tissue.pairs());
  for (const float shade : {-40.0f, 0.0f, 40.0f}) {
    const cv::Vec3f colour = cv::Vec3f(110, 125, 160) + shade * cv::Vec3f(0.9f, 1.0f, 0.8f);
    EXPECT_NEAR(mix.left.dot(colour), mix.right.dot(tissue.right(colour)), 0.3);
  }
}

TEST(ColourMix, LeavesOutAColourThatIsMostlyNoise) {
  Tissue tissue;
  tissue.noise = {12, 1.5, 1.5};
  const ColourMix mix = chooseMix(tissue.pairs());
  EXPECT_LT(mix.left[0], 0.06);
  EXPECT_GT(std::min(mix.left[1], mix.left[2]), 0.3);
}

TEST(ColourMix, DoesNotRelyOnAColourThatIsFullOverPartOfTheImage) {
  // A full colour has no noise: without the blocks' own signal it would look like the best.
  Tissue tissue;
  tissue.both = [](const cv::Vec3f& colour) { return cv::Vec3f(colour[0], colour[1], colour[2] + 85); };
  std::vector<ColourPair> pairs = tissue.pairs();
  for (ColourPair& pair : pairs)
    if (pair.left[2] > 250 || pair.right[2] > 250) pair.left_slope[2] = pair.right_slope[2] = 0;
  EXPECT_LT(chooseMix(pairs).left[2], 0.34);
}

TEST(ColourMix, OnlyWhatIsAboveTheFullLevelSaysNothingOfItsNoise) {
  Tissue tissue;
  tissue.noise = {12, 1.5, 1.5};
  for (const auto& [level, seen] : {std::pair(250.0f, true), std::pair(251.0f, false)}) {
    std::vector<ColourPair> pairs = tissue.pairs();
    for (ColourPair& pair : pairs) pair.left[1] = pair.right[1] = level;
    EXPECT_EQ(chooseMix(pairs).left[0] < 0.06f, seen) << level;
  }
}

TEST(ColourMix, IsTheMeanWhereTooFewPlacesAreSeen) {
  Tissue tissue;
  tissue.noise = {12, 1.5, 1.5};
  const ColourMix mix = chooseMix(tissue.pairs(100));
  EXPECT_FLOAT_EQ(mix.left[0], 1.0f / 3);
  EXPECT_FLOAT_EQ(mix.right[0], 1.0f / 3);
}

}  // namespace
}  // namespace cortshift_stereo
