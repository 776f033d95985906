#include "calibration/stereo/board_fit.hpp"

#include <cmath>
#include <opencv2/calib3d.hpp>

#include "calibration/least_squares.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {

cv::Matx33d rotationOf(const cv::Vec3d& turn) {
  cv::Matx33d rotation;
  cv::Rodrigues(turn, rotation);
  return rotation;
}

Eigen::VectorXd reprojection(const StereoParameters& camera, const std::vector<cv::Point3d>& board,
                             const BoardPair& pair, const Eigen::VectorXd& pose_left_board) {
  const cv::Vec3d turn(pose_left_board(0), pose_left_board(1), pose_left_board(2));
  const cv::Vec3d shift(pose_left_board(3), pose_left_board(4), pose_left_board(5));
  cv::Vec3d turn_right;
  cv::Rodrigues(camera.R_right_left * rotationOf(turn), turn_right);
  const cv::Vec3d shift_right = camera.R_right_left * shift + camera.t_right_left;
  const Corners left = projectPoints(camera.left(), board, turn, shift);
  const Corners right = projectPoints(camera.right(), board, turn_right, shift_right);
  const Eigen::Index count = static_cast<Eigen::Index>(board.size());
  Eigen::VectorXd residuals(4 * count);
  for (Eigen::Index i = 0; i < count; ++i) {
    residuals.segment<2>(2 * i) << left[i].x - pair.left[i].x, left[i].y - pair.left[i].y;
    residuals.segment<2>(2 * (count + i)) << right[i].x - pair.right[i].x, right[i].y - pair.right[i].y;
  }
  return residuals;
}

Eigen::VectorXd startPose(const StereoParameters& camera, const std::vector<cv::Point3d>& board,
                          const BoardPair& pair) {
  const auto T_left_board = locateBoard(camera.left(), board, pair.left);
  if (!T_left_board)
    throw CalibrationError("view " + pair.name + ": no pose of the board fits its corners; take the view out");
  const cv::Vec3d turn = T_left_board->rvec(), shift = T_left_board->translation();
  Eigen::VectorXd pose(6);
  pose << turn[0], turn[1], turn[2], shift[0], shift[1], shift[2];
  return pose;
}

Eigen::VectorXd fitBoardPose(const StereoParameters& camera, const std::vector<cv::Point3d>& board,
                             const BoardPair& pair) {
  const auto residuals = [&](std::size_t, const Eigen::VectorXd&, const Eigen::VectorXd& pose) {
    return reprojection(camera, board, pair, pose);
  };
  return minimise(residuals, Eigen::VectorXd(0), {startPose(camera, board, pair)}).own.front();
}

double rmsDistance(const Eigen::VectorXd& residuals) {
  return std::sqrt(2 * residuals.squaredNorm() / static_cast<double>(residuals.size()));
}

namespace {

constexpr Eigen::Index kIntrinsics = 4;

/// Changes of one camera: focal lengths and principal point in shares of the focal length, then the terms that are
/// free.
void change(const Eigen::VectorXd& by, Eigen::Index from, int terms, cv::Matx33d& K, std::vector<double>& D) {
  const double focal = K(0, 0);
  K(0, 0) += focal * by(from);
  K(1, 1) += focal * by(from + 1);
  K(0, 2) += focal * by(from + 2);
  K(1, 2) += focal * by(from + 3);
  for (int i = 0; i < terms; ++i) D[static_cast<std::size_t>(i)] += by(from + kIntrinsics + i);
}

}  // namespace

StereoParameters fitEquidistant(const std::vector<cv::Point3d>& board, const std::vector<BoardPair>& pairs,
                                const StereoParameters& start, int terms) {
  StereoParameters first = start;
  if (start.lens != LensModel::kEquidistant) {
    first.lens = LensModel::kEquidistant;
    // The tangent of the angle bends by a^3 / 3 where the angle itself does not.
    first.D_left = {start.D_left[0] + 1.0 / 3, 0, 0, 0};
    first.D_right = {start.D_right[0] + 1.0 / 3, 0, 0, 0};
  }
  for (std::size_t i = static_cast<std::size_t>(terms); i < first.D_left.size(); ++i)
    first.D_left[i] = first.D_right[i] = 0;
  const Eigen::Index free = kIntrinsics + terms, count = 2 * free + 6;
  const auto changed = [&](const Eigen::VectorXd& by) {
    StereoParameters camera = first;
    change(by, 0, terms, camera.K_left, camera.D_left);
    change(by, free, terms, camera.K_right, camera.D_right);
    camera.R_right_left = rotationOf({by(2 * free), by(2 * free + 1), by(2 * free + 2)}) * first.R_right_left;
    camera.t_right_left += cv::Vec3d(by(2 * free + 3), by(2 * free + 4), by(2 * free + 5));
    return camera;
  };
  std::vector<Eigen::VectorXd> poses;
  for (const auto& pair : pairs) poses.push_back(startPose(first, board, pair));
  const auto residuals = [&](std::size_t view, const Eigen::VectorXd& shared, const Eigen::VectorXd& pose) {
    return reprojection(changed(shared), board, pairs[view], pose);
  };
  return changed(minimise(residuals, Eigen::VectorXd::Zero(count), poses).shared);
}

}  // namespace cortshift_stereo
