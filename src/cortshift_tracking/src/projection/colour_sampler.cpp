#include "projection/colour_sampler.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cortshift_tracking {
namespace {

void catmullRom(float t, float (&w)[4]) {
  w[0] = t * (-0.5F + t * (1.0F - 0.5F * t));
  w[1] = 1.0F + t * t * (-2.5F + 1.5F * t);
  w[2] = t * (0.5F + t * (2.0F - 1.5F * t));
  w[3] = t * t * (-0.5F + 0.5F * t);
}

}  // namespace

ColourSampler::ColourSampler(const cv::Mat& image, double step) : image_(image) {
  if (step <= 1.5) return;  // the camera's pixels have already removed most detail that is too fine for the grid
  const double sigma = 0.5 * std::sqrt(step * step - 1);
  image_ = cv::Mat();  // not blurred in place: the pixels are the caller's
  cv::GaussianBlur(image, image_, cv::Size(), sigma, sigma, cv::BORDER_REPLICATE);
}

cv::Vec3f ColourSampler::at(float column, float row) const {
  const int x = static_cast<int>(std::floor(column)), y = static_cast<int>(std::floor(row));
  float wx[4], wy[4];
  catmullRom(column - static_cast<float>(x), wx);
  catmullRom(row - static_cast<float>(y), wy);
  int offsets[4];
  for (int i = 0; i < 4; ++i) offsets[i] = 3 * std::clamp(x - 1 + i, 0, image_.cols - 1);
  cv::Vec3f sum(0, 0, 0);
  for (int j = 0; j < 4; ++j) {
    const uchar* line = image_.ptr<uchar>(std::clamp(y - 1 + j, 0, image_.rows - 1));
    for (int c = 0; c < 3; ++c) {
      const float across =
          wx[0] * static_cast<float>(line[offsets[0] + c]) + wx[1] * static_cast<float>(line[offsets[1] + c]) +
          wx[2] * static_cast<float>(line[offsets[2] + c]) + wx[3] * static_cast<float>(line[offsets[3] + c]);
      sum[c] += wy[j] * across;
    }
  }
  for (int c = 0; c < 3; ++c) sum[c] = std::clamp(sum[c] * (1.0F / 255.0F), 0.0F, 1.0F);
  return sum;
}

}  // namespace cortshift_tracking
