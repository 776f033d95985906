// A board's pose in both cameras of the head, and how far its corners are from where the cameras see them.
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

/// The pose that fits the corners of both images best. @throws CalibrationError as above
Eigen::VectorXd fitBoardPose(const StereoParameters& camera, const std::vector<cv::Point3d>& board,
                             const BoardPair& pair);

/// Root of the mean squared distance, two residuals making one point.
double rmsDistance(const Eigen::VectorXd& residuals);

/// Both cameras with equidistant lenses and their relative pose, all together by least squares: OpenCV's own
/// calibration of fisheyes gives up on the small fields of microscopes, where its terms hardly differ.
/// @param start  another lens fitted to the same pairs
/// @param terms  1 to 4 coefficients are estimated, the others are 0
StereoParameters fitEquidistant(const std::vector<cv::Point3d>& board, const std::vector<BoardPair>& pairs,
                                const StereoParameters& start, int terms);

}  // namespace cortshift_stereo
