// The best closed line around a point, in pictures unrolled about that point.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace cortshift_tracking {

/// Directions that a picture is unrolled into.
constexpr int kDirections = 360;

/// Around a point: column j of what is unrolled looks along the angle 2 pi j / kDirections, row i is
/// base[j] + first + i * step away from the centre. Lengths in pixels of the picture.
struct Unrolling {
  cv::Point2f centre;
  std::vector<float> base = std::vector<float>(kDirections, 0);
  float first = 0, step = 1;
  int rows = 0;

  cv::Point2f at(int column, float row) const;
  /// CV_32FC1, bilinear; NaN outside the picture and beside its NaN. @param picture CV_32FC1
  cv::Mat unroll(const cv::Mat& picture) const;
};

/// The row of each column for which the sum of `score` is largest, with `bend` taken off for every row of change
/// from one column to the next and changes of at most 2 rows; closed: the last column borders on the first. By dynamic
/// programming, twice around: the second time from where the first passes half-way.
/// @param score CV_32FC1 without NaN
std::vector<int> bestClosedPath(const cv::Mat& score, float bend);

/// Mean over a window that closes around the columns; NaN does not count. @param share of what counts, out
cv::Mat meanAround(const cv::Mat& unrolled, cv::Size window, cv::Mat& share);

}  // namespace cortshift_tracking
