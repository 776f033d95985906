// Disparities on a grid of square cells of pixels.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_stereo {

constexpr float kSameSurface = 0.75f;  // [px] from the cells' surface: pixels beyond lie on another one

inline cv::Size cellsOf(const cv::Size& image, int cell) {
  return {(image.width + cell - 1) / cell, (image.height + cell - 1) / cell};
}

/// @param sigma  [cells]
cv::Mat blurCells(const cv::Mat& values, double sigma);

/// Smooths differences of less than a pixel (noise of the matching) and keeps larger steps.
cv::Mat smoothBelowAPixel(const cv::Mat& d);

/// Mean of the pixels of each cell that lie on the same surface as the middle of the cell.
cv::Mat meanOfCells(const cv::Mat& d, int cell);

/// Share of each cell that a mask covers.
cv::Mat shareOfCells(const cv::Mat& mask, int cell);

/// The surface through the values at the middles of the cells, at each pixel. A plane stays a plane exactly; with
/// OpenCV's cubic kernel (a = -3/4) it would not.
cv::Mat surfaceThrough(const cv::Mat& cells, const cv::Size& size, int cell);

/// Pixels on the old surface move to the new one; others stay.
void follow(cv::Mat& d, const cv::Mat& before, const cv::Mat& after);

}  // namespace cortshift_stereo
