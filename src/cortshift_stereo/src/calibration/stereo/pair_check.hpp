// How well pairs of images of a board agree with a calibration.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

namespace cortshift_stereo {

cv::Matx33d rotationOf(const cv::Vec3d& turn);

/// Root mean square distance of the corners of both images from the board where it fits them best [px].
/// @throws CalibrationError if no pose fits
double rmsReprojection(const StereoParameters& camera, const std::vector<cv::Point3d>& board, const BoardPair& pair);

SetErrors summarise(std::vector<PairErrors> pairs);

}  // namespace cortshift_stereo
