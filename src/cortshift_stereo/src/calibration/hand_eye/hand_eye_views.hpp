// The views of a hand-eye calibration: where each sees the board, and which of them do not belong to the others.
#pragma once

#include <opencv2/calib3d.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/hand_eye/hand_eye.hpp"

namespace cortshift_stereo {

/// Why the tracked poses and the images give no solution.
extern const std::string kNotTogether;

/// A view and the pose of the board that its image alone gives.
struct LocatedView {
  HandEyeView view;
  cv::Affine3d T_left_board;
  double fit_px = 0;
};

/// None where the method finds no rotation in the views.
std::optional<cv::Affine3d> solveClosedForm(const std::vector<LocatedView>& views, cv::HandEyeCalibrationMethod method);

/// The board's corners as each view puts them into the reference frame, given the camera's pose in the microscope.
class BoardInReference {
 public:
  BoardInReference(const std::vector<cv::Point3d>& board, const cv::Affine3d& T_microscope_left,
                   const std::vector<LocatedView>& views);

  /// Root mean square distance of a view's corners from the typical ones [m].
  double distance(const LocatedView& located) const;
  std::vector<double> distances(const std::vector<LocatedView>& views) const;

 private:
  std::vector<cv::Point3d> place(const LocatedView& located) const;

  const std::vector<cv::Point3d>& board_;
  cv::Affine3d T_microscope_left_;
  std::vector<cv::Point3d> typical_;
};

double meanSquare(const std::vector<double>& values);

/// Takes a view out. @throws CalibrationError if too few are left
void reject(std::vector<LocatedView>& views, std::size_t at, const std::string& reason,
            std::vector<RejectedView>& rejected);

/// The views whose corners fit the board and whose tracked poses do not grossly disagree.
/// @throws CalibrationError if they are too few, or have no common solution
std::vector<LocatedView> screen(const CameraModel& left, const std::vector<cv::Point3d>& board,
                                const std::vector<HandEyeView>& views, std::vector<RejectedView>& rejected);

}  // namespace cortshift_stereo
