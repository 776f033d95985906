// A stereo head and what its cameras see of a board.
#pragma once

#include <opencv2/core/affine.hpp>
#include <random>
#include <string>
#include <vector>

#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {

/// A microscope's two cameras, verging on a point 0.3 m away.
inline StereoParameters someHead() {
  StereoParameters head;
  head.size = {1024, 768};
  head.K_left = {2400, 0, 500, 0, 2390, 390, 0, 0, 1};
  head.K_right = {2420, 0, 530, 0, 2425, 370, 0, 0, 1};
  head.D_left = {-0.25, 0, 0, 0, 0};
  head.D_right = {-0.22, 0, 0, 0, 0};
  const cv::Affine3d T_left_right(cv::Vec3d(0.004, -0.083, 0.002), cv::Vec3d(0.025, 0.0003, 0.001));
  head.R_right_left = T_left_right.inv().rotation();
  head.t_right_left = T_left_right.inv().translation();
  return head;
}

/// Noisy views of a board tilted by up to `tilt` [rad]. `spread` says how far from the middle, `late` how far the board
/// moves on before the right camera looks [m].
inline std::vector<BoardPair> someViews(const StereoParameters& head, const Board& board, int count, double tilt,
                                        double noise, unsigned seed, double spread = 1, double late = 0) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<BoardPair> views;
  for (int i = 0; i < count; ++i) {
    const cv::Affine3d turned(tilt * cv::Vec3d(unit(random), unit(random), unit(random)));
    const cv::Vec3d middle(spread * 0.01 * unit(random), spread * 0.008 * unit(random), 0.3 + 0.03 * unit(random));
    const cv::Affine3d T_left_board(turned.rotation(),
                                    middle - turned.rotation() * cv::Vec3d(4 * board.square, 2.5 * board.square, 0));
    const cv::Affine3d T_right_board =
        cv::Affine3d(head.R_right_left, head.t_right_left) *
        (late > 0 ? T_left_board.translate(late * cv::Vec3d(unit(random), unit(random), 0)) : T_left_board);
    BoardPair view{std::to_string(i + 1), {}, {}};
    view.left = projectPoints(head.left(), board.points(), T_left_board.rvec(), T_left_board.translation());
    view.right = projectPoints(head.right(), board.points(), T_right_board.rvec(), T_right_board.translation());
    for (auto* corners : {&view.left, &view.right})
      for (auto& corner : *corners) corner += noise * cv::Point2d(normal(random), normal(random));
    views.push_back(view);
  }
  return views;
}

const Board kBoard{{9, 6}, 0.008};

}  // namespace cortshift_stereo
