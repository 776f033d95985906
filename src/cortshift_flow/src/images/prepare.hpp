// From images as users have them to what the method works on.
#pragma once

#include <opencv2/core.hpp>

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// Checks sizes, types and masks.
/// @throws std::invalid_argument naming what is wrong.
void checkImages(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask);

/// Both images as floats 0...1 in three channels (a grey one three times) and an unused fourth. What a mask excludes
/// or is not finite is filled from its surroundings; its own value is lost, so it cannot matter.
Level prepareImages(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask,
                    int threads);

/// Both images at half the size; a coarse pixel is valid where all that it was made of is.
Level halve(const Level& level, int threads);

/// Points whose 4 x 4 interpolation neighbourhood touches no excluded pixel; by the pixel at their upper left.
cv::Mat1b interpolable(const cv::Mat1b& valid);

/// The level with its second mask reduced to interpolable points.
Level interpolableLevel(const Level& level);

/// The level with its images in the other order.
Level swapped(const Level& level);

}  // namespace cortshift_flow
