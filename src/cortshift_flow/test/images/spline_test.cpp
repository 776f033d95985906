// The spline passes through the samples, and what is linearised along it are its own slopes.
#include "images/spline.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "textures.hpp"
#include "variational/data_term.hpp"

namespace cortshift_flow {
namespace {

const cv::Size kSize(37, 29);

float at(const SplineImage& image, float x, float y) {
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  float wx[4], wy[4], unused[4];
  splineWeights(x - static_cast<float>(ix), wx, unused);
  splineWeights(y - static_cast<float>(iy), wy, unused);
  float sum = 0;
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i)
      sum +=
          wx[i] * wy[j] * image.coefficients(iy - 1 + j + SplineImage::kBorder, ix - 1 + i + SplineImage::kBorder)[0];
  return sum;
}

TEST(SplineWeights, SumToOneAndTheirDerivativesToNothing) {
  for (const float t : {0.f, 0.2f, 0.5f, 0.9f, 1.f}) {
    float w[4], d[4], later[4], unused[4];
    splineWeights(t, w, d);
    EXPECT_NEAR(w[0] + w[1] + w[2] + w[3], 1, 1e-6);
    EXPECT_NEAR(d[0] + d[1] + d[2] + d[3], 0, 1e-6);
    EXPECT_NEAR(-w[0] + w[2] + 2 * w[3], t, 1e-6);  // a ramp stays one
    splineWeights(t + 1e-3f, later, unused);
    for (int i = 0; i < 4; ++i) EXPECT_NEAR((later[i] - w[i]) / 1e-3f, d[i], 2e-3) << t << " " << i;
  }
}

TEST(SplineCoefficients, TheSplinePassesThroughTheSamplesUpToTheRim) {
  const cv::Mat4f image = grains(kSize, 3);
  const SplineImage spline = splineCoefficients(image, 1);
  EXPECT_EQ(spline.coefficients.size(),
            cv::Size(kSize.width + 2 * SplineImage::kBorder, kSize.height + 2 * SplineImage::kBorder));
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x)
      EXPECT_NEAR(at(spline, static_cast<float>(x), static_cast<float>(y)), image(y, x)[0], 1e-3) << x << " " << y;
}

TEST(SplineCoefficients, SameBitsForOneAndManyThreads) {
  const cv::Mat4f image = grains({200, 301}, 3);
  const cv::Mat4f one = splineCoefficients(image, 1).coefficients, many = splineCoefficients(image, 3).coefficients;
  EXPECT_EQ(cv::norm(one.reshape(1), many.reshape(1), cv::NORM_INF), 0);
}

/// The tensor of images whose every value and slope is known.
MotionTensor tensorOf(float offset, const cv::Vec4f& weights, const cv::Mat1b& second_valid = {}) {
  const auto plane = [](float x, float y) { return 0.3f + 0.01f * x - 0.02f * y; };
  ImagePair pair{imageOf(kSize, [&](float x, float y) { return plane(x, y) + offset; }),
                 splineCoefficients(imageOf(kSize, plane), 1),
                 {},
                 second_valid};
  const FlowPlanes flow = constantFlow(kSize, 1.25f, 0.5f);
  MotionTensor tensor;
  linearise(pair, flow.u, flow.v, weights, tensor, 1);
  return tensor;
}

TEST(Linearise, SumsSquaresAndProductsOverTheChannels) {
  const MotionTensor tensor = tensorOf(0.004f, {1, 2, 3, 0});
  // Slopes 0.01 and -0.02; the residual is what the flow moves along the plane, less the offset.
  const double r = 0.01 * 1.25 - 0.02 * 0.5 - 0.004, sum = 1 + 2 + 3;
  for (const int y : {10, 15})
    for (const int x : {12, 20}) {
      EXPECT_NEAR(tensor.xx.row(y)[x], sum * 1e-4, 2e-6);
      EXPECT_NEAR(tensor.yy.row(y)[x], sum * 4e-4, 4e-6);
      EXPECT_NEAR(tensor.xy.row(y)[x], sum * -2e-4, 3e-6);
      EXPECT_NEAR(tensor.xt.row(y)[x], sum * 0.01 * r, 2e-6);
      EXPECT_NEAR(tensor.yt.row(y)[x], sum * -0.02 * r, 3e-6);
      EXPECT_NEAR(tensor.tt.row(y)[x], sum * r * r, 1e-6);
    }
}

TEST(Linearise, IsNothingWhereTheSecondImageIsNotSeen) {
  cv::Mat1b valid(kSize, uchar{1});
  valid(12, 20) = 0;
  const MotionTensor tensor = tensorOf(0.01f, {1, 1, 1, 0}, valid);
  EXPECT_EQ(tensor.tt.row(12)[19], 0);  // the flow leads from (19, 12) into cell (20, 12)
  EXPECT_GT(tensor.tt.row(12)[20], 0);
  EXPECT_GT(tensor.tt.row(12)[18], 0);
  EXPECT_EQ(tensor.xx.row(10)[kSize.width - 1], 0);  // beyond the right edge
  EXPECT_EQ(tensor.xx.row(kSize.height - 1)[10], 0);
}

}  // namespace
}  // namespace cortshift_flow
