// A plane of floats with a border of one row above and below and some columns to the sides, so that stencils need no
// case for the image's edge.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace cortshift_flow {

class Plane {
 public:
  Plane() = default;
  Plane(int height, int width, float value = 0) { create(height, width, value); }
  explicit Plane(cv::Size size, float value = 0) { create(size.height, size.width, value); }

  /// Sets every value, the border's included.
  void create(int height, int width, float value = 0) {
    height_ = height;
    width_ = width;
    stride_ = (width + 2 * kMargin + 15) / 16 * 16;
    data_.assign(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(height + 2), value);
  }

  int height() const { return height_; }
  int width() const { return width_; }
  cv::Size size() const { return {width_, height_}; }
  bool empty() const { return data_.empty(); }

  /// Row y, -1...height; its elements -16...width+15 may be read.
  float* row(int y) { return data_.data() + static_cast<std::ptrdiff_t>(y + 1) * stride_ + kMargin; }
  const float* row(int y) const { return data_.data() + static_cast<std::ptrdiff_t>(y + 1) * stride_ + kMargin; }

  /// Repeats the outermost rows and columns once into the border.
  void replicateBorder() {
    for (int y = 0; y < height_; ++y) {
      float* r = row(y);
      r[-1] = r[0];
      r[width_] = r[width_ - 1];
    }
    std::copy(row(0) - 1, row(0) + width_ + 1, row(-1) - 1);
    std::copy(row(height_ - 1) - 1, row(height_ - 1) + width_ + 1, row(height_) - 1);
  }

 private:
  static constexpr int kMargin = 16;
  int height_ = 0, width_ = 0, stride_ = 0;
  std::vector<float> data_;
};

}  // namespace cortshift_flow
