// Cubic B-spline interpolation: coefficients whose spline passes through the image's samples (Unser 1999).
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_flow {

/// Coefficients of an image, with a border so that a 4 x 4 neighbourhood can be read around every point of the image.
struct SplineImage {
  static constexpr int kBorder = 3;
  cv::Mat4f coefficients;  ///< (H + 2 kBorder) x (W + 2 kBorder)
  int width = 0, height = 0;
};

SplineImage splineCoefficients(const cv::Mat4f& image, int threads);

/// Weights of the four coefficients around a point, and of their derivatives; t: 0...1 past the second.
inline void splineWeights(float t, float* weight, float* derivative) {
  const float s = 1 - t;
  weight[0] = s * s * s * (1 / 6.f);
  weight[3] = t * t * t * (1 / 6.f);
  weight[1] = 2 / 3.f - 0.5f * t * t * (2 - t);
  weight[2] = 2 / 3.f - 0.5f * s * s * (2 - s);
  derivative[0] = -0.5f * s * s;
  derivative[3] = 0.5f * t * t;
  derivative[1] = 0.5f * t * (3 * t - 4);
  derivative[2] = -0.5f * s * (3 * s - 4);
}

}  // namespace cortshift_flow
