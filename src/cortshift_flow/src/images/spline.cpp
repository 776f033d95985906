#include "images/spline.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "parallel.hpp"

namespace cortshift_flow {
namespace {

// The inverse of the sampled cubic B-spline (1 4 1) / 6 is sqrt(3) z^|k| with z = sqrt(3) - 2. Cut after seven taps
// (z^7 = 1e-4) it needs no recursion and every row can be filtered by itself.
constexpr int kReach = 6;

std::array<float, kReach + 1> inverseSpline() {
  const double z = std::sqrt(3.0) - 2;
  std::array<double, kReach + 1> taps{};
  double sum = 0;
  for (int k = 0; k <= kReach; ++k) {
    taps[static_cast<std::size_t>(k)] = std::sqrt(3.0) * std::pow(z, k);
    sum += (k ? 2 : 1) * taps[static_cast<std::size_t>(k)];
  }
  std::array<float, kReach + 1> normalised{};
  for (std::size_t k = 0; k <= kReach; ++k) normalised[k] = static_cast<float>(taps[k] / sum);
  return normalised;
}

/// Mirrors an index about the first and the last sample.
int mirrored(int i, int count) {
  if (count == 1) return 0;
  const int period = 2 * (count - 1);
  i = std::abs(i) % period;
  return i < count ? i : period - i;
}

CORTSHIFT_VECTORISED
void filterColumns(const float* const* rows, const float* taps, float* out, int count) {
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    float sum = taps[0] * rows[kReach][i];
    for (int k = 1; k <= kReach; ++k) sum += taps[k] * (rows[kReach - k][i] + rows[kReach + k][i]);
    out[i] = sum;
  }
}

CORTSHIFT_VECTORISED
void filterRow(const float* row, const float* taps, float* out, int count) {
#pragma GCC ivdep
  for (int i = 0; i < count; ++i) {
    float sum = taps[0] * row[i];
    for (int k = 1; k <= kReach; ++k) sum += taps[k] * (row[i - 4 * k] + row[i + 4 * k]);
    out[i] = sum;
  }
}

}  // namespace

SplineImage splineCoefficients(const cv::Mat4f& image, int threads) {
  constexpr int kBorder = SplineImage::kBorder;
  const std::array<float, kReach + 1> taps = inverseSpline();
  SplineImage spline;
  spline.width = image.cols;
  spline.height = image.rows;
  spline.coefficients.create(image.rows + 2 * kBorder, image.cols + 2 * kBorder);
  forRows(spline.coefficients.rows, threads, [&](int begin, int end) {
    constexpr int kMargin = kReach + kBorder;
    std::vector<float> buffer(static_cast<std::size_t>(image.cols + 2 * kMargin) * 4);
    float* row = buffer.data() + 4 * kMargin;
    for (int y = begin; y < end; ++y) {
      std::array<const float*, 2 * kReach + 1> rows{};
      for (int k = -kReach; k <= kReach; ++k)
        rows[static_cast<std::size_t>(k + kReach)] = image.ptr<float>(mirrored(y - kBorder + k, image.rows));
      filterColumns(rows.data(), taps.data(), row, 4 * image.cols);
      for (int beyond = 1; beyond <= kMargin; ++beyond)
        for (int c = 0; c < 4; ++c) {
          row[-4 * beyond + c] = row[4 * mirrored(-beyond, image.cols) + c];
          row[4 * (image.cols - 1 + beyond) + c] = row[4 * mirrored(image.cols - 1 + beyond, image.cols) + c];
        }
      filterRow(row - 4 * kBorder, taps.data(), spline.coefficients.ptr<float>(y), 4 * spline.coefficients.cols);
    }
  });
  return spline;
}

}  // namespace cortshift_flow
