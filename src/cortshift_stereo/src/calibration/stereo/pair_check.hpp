// How well pairs of images of a board agree with a calibration.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

namespace cortshift_stereo {

cv::Matx33d rotationOf(const cv::Vec3d& turn);

/// Distances of the corners, left ones first, from the board at a pose in the left camera [px].
/// @param pose_left_board  rotation vector, then translation [m]
Eigen::VectorXd reprojection(const StereoParameters& camera, const std::vector<cv::Point3d>& board,
                             const BoardPair& pair, const Eigen::VectorXd& pose_left_board);

/// The pose that fits the corners of the left image. @throws CalibrationError naming the view if none does
Eigen::VectorXd startPose(const StereoParameters& camera, const std::vector<cv::Point3d>& board, const BoardPair& pair);

/// Root mean square distance of the corners of both images from the board where it fits them best [px].
/// @throws CalibrationError if no pose fits
double rmsReprojection(const StereoParameters& camera, const std::vector<cv::Point3d>& board, const BoardPair& pair);

SetErrors summarise(std::vector<PairErrors> pairs);

}  // namespace cortshift_stereo
