#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cortshift_tracking/matching/image_matching.hpp"

namespace cortshift_tracking {
namespace {

/// Averages of 2 x 2 pixels with their weights; a pixel of the smaller image without any weight is 0.
void halve(const cv::Mat& image, const cv::Mat& weight, cv::Mat& smaller, cv::Mat& smaller_weight) {
  const int channels = image.channels();
  smaller = cv::Mat::zeros((image.rows + 1) / 2, (image.cols + 1) / 2, image.type());
  smaller_weight = cv::Mat::zeros(smaller.size(), CV_32FC1);
  for (int row = 0; row < smaller.rows; ++row)
    for (int column = 0; column < smaller.cols; ++column) {
      float sum[3] = {0, 0, 0}, total = 0;
      for (int y = 2 * row; y < std::min(2 * row + 2, image.rows); ++y)
        for (int x = 2 * column; x < std::min(2 * column + 2, image.cols); ++x) {
          const float w = weight.ptr<float>(y)[x];
          total += w;
          for (int c = 0; c < channels; ++c) sum[c] += w * image.ptr<float>(y)[x * channels + c];
        }
      if (!(total > 0)) continue;
      smaller_weight.ptr<float>(row)[column] = std::min(1.0F, total);
      for (int c = 0; c < channels; ++c) smaller.ptr<float>(row)[column * channels + c] = sum[c] / total;
    }
}

}  // namespace

cv::Mat fillHoles(const cv::Mat& image, const cv::Mat& mask) {
  std::vector<cv::Mat> images{image.clone()}, weights(1);
  mask.convertTo(weights[0], CV_32F, 1.0 / 255.0);
  while (images.back().rows > 1 || images.back().cols > 1) {
    cv::Mat smaller, smaller_weight;
    halve(images.back(), weights.back(), smaller, smaller_weight);
    images.push_back(smaller);
    weights.push_back(smaller_weight);
  }
  for (std::size_t level = images.size() - 1; level-- > 0;) {
    cv::Mat coarse;
    cv::resize(images[level + 1], coarse, images[level].size(), 0, 0, cv::INTER_LINEAR);
    coarse.copyTo(images[level], weights[level] == 0);
  }
  return images[0];
}

}  // namespace cortshift_tracking
