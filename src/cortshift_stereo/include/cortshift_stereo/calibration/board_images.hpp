// A folder of chessboard pairs, leftNN.* and rightNN.*.
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

namespace cortshift_stereo {

/// What a folder of chessboard images holds.
struct BoardImages {
  cv::Size size;                       ///< of every image [px]
  std::vector<BoardPair> pairs;        ///< where both sides show the whole board, by ascending number
  std::vector<RejectedView> rejected;  ///< views with one side only, or where the board was not found
};

/// Find the board in every pair of a folder. Other files in it are ignored.
/// @param progress  called with a share (0...1) as the work goes on; may be empty
/// @throws CalibrationError naming the folder or file and the remedy: no such folder, no pairs in it, an image that
///         cannot be read, images of different sizes, two images of one name, or the board in none of the pairs.
BoardImages findBoards(const std::string& folder, const Board& board, const std::function<void(double)>& progress = {});

}  // namespace cortshift_stereo
