#pragma once

#include <opencv2/core.hpp>

namespace cortshift_tracking {

/// CV_32FC2: where each pixel of the earlier image is found in the later one.
inline cv::Mat flowTargets(const cv::Mat& flow) {
  cv::Mat map(flow.size(), CV_32FC2);
  for (int row = 0; row < flow.rows; ++row)
    for (int column = 0; column < flow.cols; ++column)
      map.at<cv::Vec2f>(row, column) =
          flow.at<cv::Vec2f>(row, column) + cv::Vec2f(static_cast<float>(column), static_cast<float>(row));
  return map;
}

}  // namespace cortshift_tracking
