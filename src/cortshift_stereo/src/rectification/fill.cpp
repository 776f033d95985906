#include "rectification/fill.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace cortshift_stereo {

cv::Mat fillUnknown(const cv::Mat& values, const cv::Mat& known) {
  cv::Mat weight, filled = values.clone();
  filled.setTo(0, ~known);
  known.convertTo(weight, CV_32F, 1.0 / 255);
  std::vector<cv::Mat> sums{filled}, weights{weight};
  for (double scale = 0.25; std::min(sums.back().rows, sums.back().cols) > 8; scale = 0.5) {
    cv::Mat sum, w;
    cv::resize(sums.back(), sum, {}, scale, scale, cv::INTER_AREA);
    cv::resize(weights.back(), w, {}, scale, scale, cv::INTER_AREA);
    sums.push_back(sum);
    weights.push_back(w);
  }
  cv::Mat coarse = sums.back() / (weights.back() + 1e-9f), fine;
  for (std::size_t i = sums.size() - 1; i-- > 1;) {
    cv::resize(coarse, fine, sums[i].size(), 0, 0, cv::INTER_LINEAR);
    constexpr float kPull = 1e-3f;
    coarse = (sums[i] + kPull * fine) / (weights[i] + kPull);
  }
  cv::resize(coarse, fine, values.size(), 0, 0, cv::INTER_LINEAR);
  fine.copyTo(filled, ~known);
  return filled;
}

}  // namespace cortshift_stereo
