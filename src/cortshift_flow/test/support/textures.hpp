// Small images that tests of single steps share.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/imgproc.hpp>

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// Grains of about `width` pixels, 0...1, different in each of three channels.
inline cv::Mat4f grains(cv::Size size, std::uint64_t seed, double width = 1.5) {
  cv::Mat4f image(size);
  cv::RNG random(seed);
  random.fill(image, cv::RNG::UNIFORM, 0, 1);
  cv::GaussianBlur(image, image, cv::Size(), width, width, cv::BORDER_REFLECT);
  cv::Mat spread = (image - cv::Scalar::all(0.5)) * width * 2 + cv::Scalar::all(0.5);
  cv::Mat4f out(spread);
  for (auto& value : out) value[3] = 0;
  return out;
}

/// The image of a function of column and row, the same in three channels.
inline cv::Mat4f imageOf(cv::Size size, const std::function<float(float, float)>& value) {
  cv::Mat4f image(size);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) {
      const float v = value(static_cast<float>(x), static_cast<float>(y));
      image(y, x) = {v, v, v, 0};
    }
  return image;
}

inline FlowPlanes flowOf(cv::Size size, const std::function<cv::Vec2f(float, float)>& value) {
  FlowPlanes flow{Plane(size), Plane(size)};
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) {
      const cv::Vec2f w = value(static_cast<float>(x), static_cast<float>(y));
      flow.u.row(y)[x] = w[0];
      flow.v.row(y)[x] = w[1];
    }
  return flow;
}

inline FlowPlanes constantFlow(cv::Size size, float u, float v) {
  return flowOf(size, [=](float, float) { return cv::Vec2f(u, v); });
}

}  // namespace cortshift_flow
