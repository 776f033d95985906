#include "images/noise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace cortshift_flow {
namespace {

constexpr int kStep = 5;                   // every so many pixels along both axes
constexpr float kLeastNoise = 0.4f / 255;  // rounding of two 8-bit images; less is not assumed of any image
constexpr float kMostNoise = 0.2f;
constexpr float kMedianToDeviation = 1.4826f;  // of a normal distribution

cv::Vec4f interpolate(const SplineImage& image, float px, float py) {
  const int ix = static_cast<int>(px), iy = static_cast<int>(py);
  std::array<float, 4> wx{}, wy{}, unused{};
  splineWeights(px - static_cast<float>(ix), wx.data(), unused.data());
  splineWeights(py - static_cast<float>(iy), wy.data(), unused.data());
  cv::Vec4f sum = cv::Vec4f::all(0);
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i)
      sum += wx[static_cast<std::size_t>(i)] * wy[static_cast<std::size_t>(j)] *
             image.coefficients(iy - 1 + j + SplineImage::kBorder, ix - 1 + i + SplineImage::kBorder);
  return sum;
}

}  // namespace

cv::Vec4f noiseWeights(const ImagePair& images, const FlowPlanes& flow, const cv::Mat1b& visible) {
  const int width = images.first.cols, height = images.first.rows;
  std::array<std::vector<float>, 3> differences;
  for (int y = 0; y < height; y += kStep)
    for (int x = 0; x < width; x += kStep) {
      if (!visible.empty() && !visible(y, x)) continue;
      const float px = static_cast<float>(x) + flow.u.row(y)[x], py = static_cast<float>(y) + flow.v.row(y)[x];
      if (!(px >= 0 && py >= 0 && px <= static_cast<float>(width - 1) && py <= static_cast<float>(height - 1)))
        continue;
      if (!images.second_valid.empty() && !images.second_valid(static_cast<int>(py), static_cast<int>(px))) continue;
      const cv::Vec4f difference = interpolate(images.second, px, py) - images.first(y, x);
      for (int c = 0; c < 3; ++c) differences[static_cast<std::size_t>(c)].push_back(std::abs(difference[c]));
    }
  cv::Vec4f weights = cv::Vec4f::all(0);
  for (int c = 0; c < 3; ++c) {
    auto& values = differences[static_cast<std::size_t>(c)];
    float deviation = kMostNoise;
    if (!values.empty()) {
      const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      deviation = std::clamp(kMedianToDeviation * *middle, kLeastNoise, kMostNoise);
    }
    weights[c] = 1 / (deviation * deviation);
  }
  return weights;
}

}  // namespace cortshift_flow
