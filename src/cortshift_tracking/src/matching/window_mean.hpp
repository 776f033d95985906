// Means over square windows of what counts.
#pragma once

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cortshift_tracking {

class WindowMean {
 public:
  /// @param weight CV_32FC1 0...1
  /// @param side of the window [m]; @param resolution [m]
  WindowMean(const cv::Mat& weight, double side, double resolution)
      : weight_(weight), side_(2 * static_cast<int>(std::lround(0.5 * side / resolution)) + 1) {
    share_ = sum(weight_);
    inverse_ = 1.0 / cv::max(share_, kLeastShare);
  }

  /// Part of each window that counts, 0...1; nothing beyond the image does.
  const cv::Mat& share() const { return share_; }
  const cv::Mat& weight() const { return weight_; }
  int side() const { return side_; }  ///< [px]

  /// Mean of CV_32FC1 values; too small where less than a tenth of the window counts.
  cv::Mat of(const cv::Mat& values) const { return sum(values.mul(weight_)).mul(inverse_); }

  static constexpr float kLeastShare = 0.1F;

 private:
  cv::Mat sum(const cv::Mat& values) const {
    cv::Mat mean;
    cv::boxFilter(values, mean, CV_32F, cv::Size(side_, side_), {-1, -1}, true, cv::BORDER_CONSTANT);
    return mean;
  }

  cv::Mat weight_, share_, inverse_;
  int side_;
};

}  // namespace cortshift_tracking
