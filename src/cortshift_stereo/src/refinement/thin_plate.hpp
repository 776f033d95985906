// Linear systems of data and bending on a grid of cells.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_stereo {

/// Minimises  sum information x^2 + 2 gradient x  +  bending . |Hess (base + x)|^2  over x.
///
/// @param information, gradient, bending, base  CV_32FC1 of one size, at least 3 x 3; the first and third not negative
/// @param steps  of preconditioned conjugate gradients
cv::Mat solveThinPlate(const cv::Mat& information, const cv::Mat& gradient, const cv::Mat& bending, const cv::Mat& base,
                       int steps);

/// Square of the norm of the Hessian by second differences, per cell; 0 on the rim.
cv::Mat squaredBending(const cv::Mat& values);

}  // namespace cortshift_stereo
