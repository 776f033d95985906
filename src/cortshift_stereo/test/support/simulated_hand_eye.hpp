// A microscope with a tracked body and a camera looks at a board from all around.
#pragma once

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <random>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/hand_eye/hand_eye.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {

struct SimulatedHandEye {
  Board board{{9, 6}, 0.006};
  CameraModel left;
  cv::Affine3d T_microscope_left{cv::Vec3d(0.03, -0.4, 1.2), cv::Vec3d(0.045, -0.06, 0.11)};
  cv::Affine3d T_reference_board{cv::Vec3d(0.2, 0.1, -0.3), cv::Vec3d(0.15, 0.08, -0.05)};
  double largest_tilt = 30 * CV_PI / 180;  ///< of the optical axis against the board's normal [rad]
  bool one_axis = false;                   ///< tilt about one axis only

  SimulatedHandEye() {
    left.size = {1024, 768};
    left.K = {2600, 0, 520, 0, 2590, 380, 0, 0, 1};
    left.D = {-0.12, 0.05, 0, 0, 0};
    left.P = {2600, 0, 520, 0, 0, 2600, 380, 0, 0, 0, 1, 0};
  }

  /// Poses of the board in the camera: the whole board in view, 0.27 to 0.33 m away.
  std::vector<cv::Affine3d> boardPoses(int count, std::mt19937& random) const {
    std::uniform_real_distribution<double> unit(-1, 1);
    std::vector<cv::Affine3d> poses;
    while (static_cast<int>(poses.size()) < count) {
      const cv::Vec3d tilt(unit(random) * largest_tilt, one_axis ? 0 : unit(random) * largest_tilt,
                           one_axis ? 0 : unit(random) * 2 * largest_tilt);
      const cv::Affine3d tilted(tilt);
      const cv::Vec3d centre(4 * board.square, 2.5 * board.square, 0);
      const cv::Vec3d place(0.015 * unit(random), 0.01 * unit(random), 0.3 + 0.03 * unit(random));
      poses.emplace_back(tilted.rotation(), place - tilted.rotation() * centre);
    }
    return poses;
  }

  cv::Affine3d microscopePose(const cv::Affine3d& T_left_board) const {
    return T_reference_board * T_left_board.inv() * T_microscope_left.inv();
  }

  /// A pose as the tracker reports it.
  static cv::Affine3d tracked(const cv::Affine3d& pose, double position_sd, double rotation_sd, std::mt19937& random) {
    std::normal_distribution<double> normal;
    const auto vector = [&](double sd) {
      return cv::Vec3d(sd * normal(random), sd * normal(random), sd * normal(random));
    };
    return pose * cv::Affine3d(vector(rotation_sd), vector(position_sd));
  }

  /// Views with noise; corners are off by `corner_sd` [px] a side.
  std::vector<HandEyeView> views(int count, double position_sd, double rotation_sd, double corner_sd,
                                 std::mt19937& random) const {
    std::normal_distribution<double> normal;
    std::vector<HandEyeView> views;
    for (const auto& T_left_board : boardPoses(count, random)) {
      HandEyeView view{"view" + std::to_string(views.size() + 1),
                       tracked(microscopePose(T_left_board), position_sd, rotation_sd, random),
                       {}};
      view.corners = projectPoints(left, board.points(), T_left_board.rvec(), T_left_board.translation());
      for (auto& corner : view.corners) corner += corner_sd * cv::Point2d(normal(random), normal(random));
      views.push_back(view);
    }
    return views;
  }
};

}  // namespace cortshift_stereo
