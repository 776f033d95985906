#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "cortshift_tracking/matching/image_matching.hpp"

namespace cortshift_tracking {
namespace {

constexpr float kMean = 0.5F;      // of the result
constexpr float kDarkest = 0.02F;  // a smaller local mean is replaced by this one in the division
constexpr float kLeastWeight = 1e-3F;

cv::Mat luminanceOf(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

cv::Mat selectChannels(const cv::Mat& colour, const std::string& channels) {
  if (channels == "rgb") return colour;
  if (channels == "luminance") return luminanceOf(colour);
  cv::Mat selected;
  cv::extractChannel(colour, selected, channels == "green" ? 1 : 0);
  return selected;
}

}  // namespace

cv::Mat flowImage(const cv::Mat& colour, const cv::Mat& usable, const std::string& channels, double detail) {
  cv::Mat image = fillHoles(selectChannels(colour, channels), usable);
  const cv::Mat grey = luminanceOf(image);
  cv::Mat weight, light, total;
  usable.convertTo(weight, CV_32F, 1.0 / 255.0);
  cv::GaussianBlur(grey.mul(weight), light, cv::Size(), detail, detail, cv::BORDER_REPLICATE);
  cv::GaussianBlur(weight, total, cv::Size(), detail, detail, cv::BORDER_REPLICATE);
  const int count = image.channels();
  for (int row = 0; row < image.rows; ++row) {
    auto* pixel = image.ptr<float>(row);
    const auto *sum = light.ptr<float>(row), *n = total.ptr<float>(row), *own = grey.ptr<float>(row);
    for (int column = 0; column < image.cols; ++column) {
      const float mean = n[column] > kLeastWeight ? sum[column] / n[column] : own[column];
      const float scale = kMean / std::max(kDarkest, mean);
      for (int c = 0; c < count; ++c) pixel[count * column + c] = std::min(1.0F, scale * pixel[count * column + c]);
    }
  }
  return image;
}

}  // namespace cortshift_tracking
