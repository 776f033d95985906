// The camera in the microscope's tracked body, from views of a board that stays where it is.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/core/affine.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/board.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"
#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// One view of the board and where the tracker saw the microscope then.
struct HandEyeView {
  std::string name;                     ///< what people call the view: its image
  cv::Affine3d T_reference_microscope;  ///< [m]
  Corners corners;                      ///< in the raw image [px]
};

/// How well the tracker is known to measure; the corrections of its poses are weighed by it.
struct HandEyeSettings {
  double tracker_position_sd = 0.25e-3;            ///< per axis [m]
  double tracker_rotation_sd = 0.1 * CV_PI / 180;  ///< per axis [rad]
  double corner_sd = 0.1;                          ///< per axis [px]

  /// @throws CalibrationError naming the setting, its value and the allowed range.
  void validate() const;
};

/// What one of OpenCV's closed-form methods says.
struct HandEyeMethodResult {
  std::string method;                 ///< Tsai, Park, Horaud, Andreff, Daniilidis
  cv::Affine3d T_microscope_left;     ///< [m]
  double translation_difference = 0;  ///< from the refined pose [m]
  double rotation_difference = 0;     ///< from the refined pose [rad]
};

/// How far a view's tracked pose is from the one that its image asks for.
struct HandEyeResidual {
  std::string name;
  double reprojection_rms = 0;   ///< with the tracked pose as it is [px]
  double position_residual = 0;  ///< correction of the tracked position [m]
  double rotation_residual = 0;  ///< correction of the tracked rotation [rad]
};

struct HandEyeCalibration {
  cv::Affine3d T_microscope_left;  ///< [m]
  cv::Affine3d T_reference_board;  ///< [m]
  cv::Vec3d position_sd;           ///< of T_microscope_left, estimated from the residuals, along the camera's axes [m]
  cv::Vec3d rotation_sd;           ///< about the camera's axes [rad]
  /// Root mean square rotation of the microscope about its mean attitude, along the principal axes of the rotations,
  /// largest first [rad]. Two of them must be large for a hand-eye calibration to mean anything.
  cv::Vec3d rotation_diversity;
  double method_spread = 0;  ///< largest distance between two methods' translations [m]
  std::vector<HandEyeMethodResult> methods;
  std::vector<HandEyeResidual> residuals;
  double misfit = 0;            ///< root mean square correction of a tracked pose [standard deviations of the tracker]
  double reprojection_rms = 0;  ///< over all views used, with the tracked poses as they are [px]
  std::vector<RejectedView> rejected;
};

constexpr std::size_t kFewestHandEyeViews = 6;
constexpr double kLeastRotationDiversity = 4 * CV_PI / 180;  ///< about the second axis [rad]

/// Calibrate: five closed-form solutions, then the maximum-likelihood pose, in which every tracked pose may move by
/// what the tracker's accuracy allows so that the reprojection error is least.
/// @throws CalibrationError naming the remedy: a board whose ends look alike, too few consistent views, too little
///         rotation, or a settings value out of range.
HandEyeCalibration calibrateHandEye(const CameraModel& left, const Board& board, const std::vector<HandEyeView>& views,
                                    const HandEyeSettings& settings = {});

}  // namespace cortshift_stereo
