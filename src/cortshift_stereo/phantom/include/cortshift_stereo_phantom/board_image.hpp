// Images of a chessboard as a camera with distortion sees it, edges as smooth as pixels make them.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/core/affine.hpp>

#include "cortshift_stereo/calibration/board.hpp"

namespace cortshift_stereo_phantom {

/// An 8-bit image of the board at a pose in the camera; the square between the first four corners is dark. Grey noise
/// of 2/255 comes from OpenCV's generator, seeded here so that every run is the same.
cv::Mat renderBoard(const cortshift_stereo::CameraModel& camera, const cv::Affine3d& T_camera_board,
                    const cortshift_stereo::Board& board);

}  // namespace cortshift_stereo_phantom
