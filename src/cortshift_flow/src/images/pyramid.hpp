// Image pyramid with ratio 0.5: the multiscale approach of Ji et al. 2014, section 2.4.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace cortshift_flow {

/// Half the size, rounded up: coarse pixel (x, y) lies on fine pixel (2x, 2y). Binomial low-pass 1 4 6 4 1.
cv::Mat4f halve(const cv::Mat4f& fine, int threads);

/// Levels from the finest (the image itself) to the first whose shorter side is below `coarsest_side`.
std::vector<cv::Mat4f> buildPyramid(const cv::Mat4f& image, int coarsest_side, int threads);

}  // namespace cortshift_flow
