// The thin plate against the dense solution of the same small system, and what the interpolation reproduces exactly.
#include "refinement/thin_plate.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "refinement/cubic.hpp"

namespace cortshift_stereo {
namespace {

const cv::Size kGrid(7, 6);

cv::Mat randomGrid(std::uint64_t seed, double low, double high) {
  cv::Mat out(kGrid, CV_32FC1);
  cv::RNG random(seed);
  random.fill(out, cv::RNG::UNIFORM, low, high);
  return out;
}

/// Minimiser of  sum information x^2 + 2 gradient x + bending (xx^2 + yy^2 + 2 xy^2)  with the second differences of
/// base + x at the inner cells, by its normal equations.
cv::Mat denseSolution(const cv::Mat& information, const cv::Mat& gradient, const cv::Mat& bending,
                      const cv::Mat& base) {
  const int n = kGrid.area(), w = kGrid.width;
  cv::Mat A = cv::Mat::zeros(n, n, CV_64F), b(n, 1, CV_64F), start(n, 1, CV_64F);
  for (int i = 0; i < n; ++i) {
    A.at<double>(i, i) = information.at<float>(i / w, i % w);
    b.at<double>(i) = -gradient.at<float>(i / w, i % w);
    start.at<double>(i) = base.at<float>(i / w, i % w);
  }
  cv::Mat bend = cv::Mat::zeros(n, n, CV_64F);
  for (int y = 1; y < kGrid.height - 1; ++y)
    for (int x = 1; x < w - 1; ++x) {
      const auto at = [&](int dy, int dx) { return (y + dy) * w + x + dx; };
      cv::Mat h = cv::Mat::zeros(3, n, CV_64F);  // xx, yy, xy
      h.at<double>(0, at(0, -1)) = h.at<double>(0, at(0, 1)) = h.at<double>(1, at(-1, 0)) = h.at<double>(1, at(1, 0)) =
          1;
      h.at<double>(0, at(0, 0)) = h.at<double>(1, at(0, 0)) = -2;
      h.at<double>(2, at(-1, -1)) = h.at<double>(2, at(1, 1)) = std::sqrt(2.0) / 4;
      h.at<double>(2, at(-1, 1)) = h.at<double>(2, at(1, -1)) = -std::sqrt(2.0) / 4;
      bend += bending.at<float>(y, x) * h.t() * h;
    }
  cv::Mat x;
  cv::solve(A + bend, b - bend * start, x, cv::DECOMP_SVD);
  return x.reshape(1, kGrid.height);
}

TEST(ThinPlate, SolvesWhatTheNormalEquationsSolve) {
  const cv::Mat information = randomGrid(1, 0.5, 2), gradient = randomGrid(2, -1, 1), bending = randomGrid(3, 0.2, 5),
                base = randomGrid(4, -2, 2);
  const cv::Mat expected = denseSolution(information, gradient, bending, base);
  const cv::Mat x = solveThinPlate(information, gradient, bending, base, 300);
  for (int row = 0; row < kGrid.height; ++row)
    for (int column = 0; column < kGrid.width; ++column)
      EXPECT_NEAR(x.at<float>(row, column), expected.at<double>(row, column), 2e-3) << row << " " << column;
}

TEST(ThinPlate, AStiffOneIsThePlaneOfTheData) {
  // Data that ask for a plane plus an alternating error: a plate of no give keeps the plane.
  cv::Mat gradient(kGrid, CV_32FC1);
  const auto plane = [](int y, int x) { return 0.3 + 0.2 * x - 0.1 * y; };
  for (int y = 0; y < kGrid.height; ++y)
    for (int x = 0; x < kGrid.width; ++x) gradient.at<float>(y, x) = static_cast<float>(-plane(y, x));
  const cv::Mat x = solveThinPlate(cv::Mat(kGrid, CV_32FC1, cv::Scalar(1)), gradient,
                                   cv::Mat(kGrid, CV_32FC1, cv::Scalar(100)), cv::Mat::zeros(kGrid, CV_32FC1), 300);
  for (int row = 0; row < kGrid.height; ++row)
    for (int column = 0; column < kGrid.width; ++column)
      EXPECT_NEAR(x.at<float>(row, column), plane(row, column), 2e-3);
}

TEST(ThinPlate, BendingOfAQuadraticIsItsHessian) {
  const double a = 0.3, b = 0.2, c = -0.4;
  cv::Mat values(kGrid, CV_32FC1);
  for (int y = 0; y < kGrid.height; ++y)
    for (int x = 0; x < kGrid.width; ++x)
      values.at<float>(y, x) = static_cast<float>(a * x * x + b * x * y + c * y * y + 3 * x - 2 * y);
  const cv::Mat bending = squaredBending(values);
  EXPECT_NEAR(bending.at<float>(2, 3), 4 * a * a + 2 * b * b + 4 * c * c, 1e-4);
  EXPECT_EQ(bending.at<float>(0, 3), 0);
  EXPECT_EQ(bending.at<float>(2, 6), 0);
}

TEST(CubicWeights, ReproduceQuadratics) {
  const auto f = [](double x) { return 0.7 - 0.4 * x + 0.3 * x * x; };
  const float samples[4] = {static_cast<float>(f(-1)), static_cast<float>(f(0)), static_cast<float>(f(1)),
                            static_cast<float>(f(2))};
  for (const double t : {0.0, 0.1, 0.37, 0.5, 0.8, 1.0}) {
    const CubicWeights weights(static_cast<float>(t));
    EXPECT_NEAR(weights.apply(samples), f(t), 1e-6) << t;
    EXPECT_NEAR(weights[0] + weights[1] + weights[2] + weights[3], 1, 1e-6) << t;
  }
  // Half a pixel: Keys' -1/16, 9/16.
  EXPECT_NEAR(CubicWeights(0.5f)[0], -1.0 / 16, 1e-7);
  EXPECT_NEAR(CubicWeights(0.5f)[1], 9.0 / 16, 1e-7);
}

}  // namespace
}  // namespace cortshift_stereo
