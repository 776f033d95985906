// Calibration of the stereo head from chessboard pairs (Ji et al. 2014, section 2.1 and Eq. 1), and its proof on pairs
// that took no part in it.
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/board.hpp"
#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// One board seen by both cameras; corner i is the same physical corner on both sides.
struct BoardPair {
  std::string name;  ///< what people call the view, such as "07"
  Corners left;      ///< [px]
  Corners right;     ///< [px]
};

/// A view that took no part, and why.
struct RejectedView {
  std::string name;
  std::string reason;
};

/// Both cameras and the pose of one in the other: what chessboards determine.
struct StereoParameters {
  cv::Size size;  ///< of the images of both cameras [px]
  cv::Matx33d K_left = cv::Matx33d::eye();
  cv::Matx33d K_right = cv::Matx33d::eye();
  LensModel lens = LensModel::kPlumbBob;  ///< of both cameras
  std::vector<double> D_left;             ///< coefficients of the lens
  std::vector<double> D_right;
  cv::Matx33d R_right_left = cv::Matx33d::eye();  ///< p_right = R_right_left p_left + t_right_left
  cv::Vec3d t_right_left;                         ///< [m]

  /// The raw cameras, not rectified.
  CameraModel left() const { return {size, K_left, lens, D_left}; }
  CameraModel right() const { return {size, K_right, lens, D_right}; }
};

/// Rectify: the model that reconstruction and ROS's camera_info want. Principal points of verging cameras stay apart.
/// @throws CalibrationError if the right camera is not to the right of the left one.
StereoModel rectify(const StereoParameters& parameters);

/// Errors of one pair under given parameters, the board's pose being fitted to both sides at once.
struct PairErrors {
  std::string name;
  double left_rms = 0;       ///< reprojection, root of the mean squared distance [px]
  double right_rms = 0;      ///< [px]
  double rms = 0;            ///< both sides [px]
  double epipolar_rms = 0;   ///< row difference of corresponding corners after rectification [px]
  double spacing_error = 0;  ///< mean |distance between neighbouring reconstructed corners - square| [m]
};

/// Errors over a set of pairs.
struct SetErrors {
  double reprojection_rms = 0;  ///< [px]
  double epipolar_rms = 0;      ///< [px]
  double spacing_error = 0;     ///< [m]
  std::vector<PairErrors> pairs;
};

/// Check parameters on pairs; the parameters stay as they are, only each board's pose is fitted.
/// @throws CalibrationError if there are no pairs or a pose cannot be found.
SetErrors checkPairs(const StereoParameters& parameters, const Board& board, const std::vector<BoardPair>& pairs);

/// One candidate for the lens distortion and its errors on pairs held out in turn (cross-validation).
struct DistortionScore {
  std::string model;  ///< the terms that are not held at 0: "k1" (the paper's), "k1 k2", ..., those of the whole lens
  SetErrors held_out;
};

struct StereoCalibration {
  StereoParameters parameters;
  std::string model;                    ///< the chosen distortion model
  std::vector<DistortionScore> scores;  ///< all candidates, from few to many terms
  SetErrors used;                       ///< on the pairs that it was fitted to
  std::vector<RejectedView> rejected;
  std::vector<RejectedView> screened;  ///< of `rejected`, the ones that disagree with the others
  double focal_deviation = 0;          ///< largest standard deviation of a focal length, relative to it
  double left_alone_rms = 0;           ///< reprojection error of the left camera when it is calibrated alone [px]
  double right_alone_rms = 0;          ///< [px]
  double reach =
      0;  ///< how far corners reach from the middle towards a corner of the image, in the worst quarter [0...1]
  double distance = 0;  ///< median distance of the boards [m]
};

constexpr std::size_t kFewestPairs = 5;

/// Calibrate both cameras. Views that disagree with the others are left out and named; the distortion model is the one
/// with the fewest terms whose error on held-out pairs is within 1 % of the best.
/// @param progress  called with a share (0...1) as the work goes on; may be empty
/// @throws CalibrationError naming the remedy: fewer than kFewestPairs consistent pairs, boards too parallel to
///         determine the focal lengths, or cameras that are swapped or not side by side.
StereoCalibration calibrateStereo(const Board& board, const cv::Size& size, const std::vector<BoardPair>& pairs,
                                  const std::function<void(double)>& progress = {},
                                  LensModel lens = LensModel::kPlumbBob);

}  // namespace cortshift_stereo
