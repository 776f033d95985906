// Dense optical flow between two projection images of a cortical surface
// (Ji et al. 2014, section 2.4; Brox et al. 2004; Liu 2009).
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_flow {

/// What computeFlow needs to know beside the images. Each default is written here and nowhere else.
struct FlowSettings {
  int threads = 0;  ///< worker threads; 0: all that OpenCV has

  /// @throws std::invalid_argument naming the setting, its value and the allowed range.
  void validate() const;
};

/// Flow from the first image to the second: first(x, y) corresponds to second(x + u, y + v).
struct FlowResult {
  cv::Mat flow;        ///< CV_32FC2, size of the first image, (u, v) in pixels; finite everywhere
  cv::Mat confidence;  ///< CV_32FC1, 0...1 per pixel of the first image; 0 where the mask excludes it
};

/// Variational flow from `first` to `second`.
///
/// @param first   H x W, CV_8U, CV_16U or CV_32F (0...1), 1 or 3 channels
/// @param second  same size and type
/// @param mask    empty, or CV_8UC1 H x W over `first`: 0 excludes a pixel
/// @param second_mask  the same over `second`
/// Excluded pixels never influence their neighbours.
/// @throws std::invalid_argument naming what is wrong with an input.
FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask,
                       const FlowSettings& settings = {});

/// The same without exclusions in the second image.
FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask = {},
                       const FlowSettings& settings = {});

}  // namespace cortshift_flow
