// A planar chessboard and its corners in an image.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/core/affine.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// Corners of one board in one image [px], row by row.
using Corners = std::vector<cv::Point2d>;

/// A chessboard by its inner corners.
struct Board {
  cv::Size corners;   ///< inner corners along x and y
  double square = 0;  ///< side of a square [m]; findBoard does without it

  /// @param text  inner corners as "9x6"
  /// @throws CalibrationError if the text has another form or says fewer than 3 corners a side.
  static cv::Size parseCorners(const std::string& text);

  /// @param text    inner corners as "9x6"
  /// @param square  [m]
  /// @throws CalibrationError as parseCorners, or if the square is not in (0, 1] m.
  static Board parse(const std::string& text, double square);

  std::string name() const;                 ///< "9x6"
  std::vector<cv::Point3d> points() const;  ///< corners in the board's frame [m], row by row, z = 0
  bool looksTheSameUpsideDown() const;      ///< turned by 180 degrees the colours agree: corners have two orders
};

/// Read an image as 8-bit grey.
/// @throws CalibrationError naming the file if it is missing or not an image.
cv::Mat readGreyImage(const std::string& path);

/// All corners of the board with sub-pixel accuracy, or none if not all of them are seen.
///
/// Order: rows as the camera sees them from the front, never mirrored; and where the colours tell the board's two ends
/// apart (one odd, one even count of corners), the square between the first four corners is dark, so that a corner's
/// index is the same physical corner in every image.
/// @param image  8-bit grey
std::optional<Corners> findBoard(const cv::Mat& image, const Board& board);

/// The board's pose that fits its corners in an image of the camera [m]; none where no pose does.
std::optional<cv::Affine3d> locateBoard(const CameraModel& camera, const std::vector<cv::Point3d>& board,
                                        const Corners& corners);

/// The same corners counted from the other end of the board.
Corners upsideDown(const Corners& corners);

}  // namespace cortshift_stereo
