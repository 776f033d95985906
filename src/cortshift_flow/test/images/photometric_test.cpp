// Changes of brightness and noise that are known.
#include "images/photometric.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "images/noise.hpp"
#include "images/spline.hpp"
#include "textures.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(120, 96);

double largestGap(const cv::Mat4f& a, const cv::Mat4f& b, int border) {
  double gap = 0;
  for (int y = border; y < a.rows - border; ++y)
    for (int x = border; x < a.cols - border; ++x)
      for (int c = 0; c < 3; ++c) gap = std::max(gap, std::abs(static_cast<double>(a(y, x)[c] - b(y, x)[c])));
  return gap;
}

double meanSquare(const cv::Mat4f& a, const cv::Mat4f& b) {
  return std::pow(cv::norm(a.reshape(1), b.reshape(1)), 2) / (3.0 * static_cast<double>(a.total()));
}

TEST(BrightnessMap, FindsGainAndOffset) {
  const cv::Mat4f first = grains(kSize, 1);
  cv::Mat4f second = first.clone();
  for (auto& value : second)
    for (int c = 0; c < 3; ++c) value[c] = 0.85f * value[c] + 0.05f;
  const BrightnessMap map = BrightnessMap::fit({first, second, {}, {}}, constantFlow(kSize, 0, 0), {}, 1);
  EXPECT_TRUE(map.significant());
  // A seventh of the difference may be left: the fit expects no change, and gives way to the data only so far.
  EXPECT_LT(meanSquare(map.apply(first, 1), second), 0.02 * meanSquare(first, second));
}

TEST(BrightnessMap, FollowsAGainThatVaries) {
  const cv::Mat4f first = grains(kSize, 1);
  cv::Mat4f second = first.clone();
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x)
      for (int c = 0; c < 3; ++c)
        second(y, x)[c] *= 0.8f + 0.003f * static_cast<float>(x) - 0.001f * static_cast<float>(y);
  const BrightnessMap map = BrightnessMap::fit({first, second, {}, {}}, constantFlow(kSize, 0, 0), {}, 1);
  EXPECT_LT(meanSquare(map.apply(first, 1), second), 0.06 * meanSquare(first, second));  // smoothed over 3 cells
  // At twice the size it is the same map.
  cv::Mat4f large(2 * kSize.height, 2 * kSize.width, cv::Vec4f::all(0.5f));
  const cv::Mat4f applied = map.apply(large, 1);
  EXPECT_NEAR(applied(96, 60)[0], 0.5 * (0.8 + 0.003 * 30 - 0.001 * 48), 0.02);
  EXPECT_NEAR(applied(96, 180)[0], 0.5 * (0.8 + 0.003 * 90 - 0.001 * 48), 0.02);
}

// A ramp is what bilinear interpolation reads exactly, at any fraction of a pixel.
TEST(BrightnessMap, SeesNoChangeUnderAFlowOfPartsOfAPixel) {
  const auto ramp = [](float x, float y) { return 0.004f * x + 0.005f * y; };
  const cv::Mat4f second = imageOf(kSize, ramp),
                  first = imageOf(kSize, [&](float x, float y) { return ramp(x + 2.3f, y - 1.6f); });
  const BrightnessMap map = BrightnessMap::fit({first, second, {}, {}}, constantFlow(kSize, 2.3f, -1.6f), {}, 1);
  EXPECT_FALSE(map.significant());
  EXPECT_LT(largestGap(map.apply(first, 1), first, 0), 1e-4);
}

TEST(BrightnessMap, IgnoresWhatIsHiddenOrMasked) {
  const cv::Mat4f first = grains(kSize, 1);
  for (const bool masked : {false, true}) {
    Level level{first, first.clone(), {}, {}};
    const cv::Rect half(0, 0, 60, 96);
    level.second(half) += cv::Scalar::all(0.2);
    cv::Mat1b shown(kSize, uchar{1});
    shown(half) = 0;
    if (masked) level.second_valid = shown;
    const BrightnessMap map = BrightnessMap::fit(level, constantFlow(kSize, 0, 0), masked ? cv::Mat1b() : shown, 1);
    EXPECT_FALSE(map.significant()) << masked;
    EXPECT_LT(largestGap(map.apply(first, 1), first, 0), 1e-3) << masked;
  }
}

TEST(NoiseWeights, AreTheInverseVarianceOfEachChannel) {
  const cv::Size size(400, 300);
  const cv::Mat4f first = grains(size, 1, 3);
  cv::Mat4f second(size);
  const float u = 3, v = -2, sigma[3] = {0.01f, 0.02f, 0.04f};
  cv::RNG random(7);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) {
      second(y, x) = first(std::clamp(y + 2, 0, size.height - 1), std::clamp(x - 3, 0, size.width - 1));
      for (int c = 0; c < 3; ++c) second(y, x)[c] += static_cast<float>(random.gaussian(sigma[c]));
    }
  const ImagePair pair{first, splineCoefficients(second, 1), {}, {}};
  const cv::Vec4f weights = noiseWeights(pair, constantFlow(size, u, v), {});
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(weights[c] * sigma[c] * sigma[c], 1, 0.15) << c;
  EXPECT_EQ(weights[3], 0);
  // Equal images: rounding of two 8-bit images is assumed.
  const ImagePair equal{first, splineCoefficients(first, 1), {}, {}};
  EXPECT_NEAR(noiseWeights(equal, constantFlow(size, 0, 0), {})[0], std::pow(255 / 0.4, 2), 1e5);
}

}  // namespace
}  // namespace cortshift_flow
