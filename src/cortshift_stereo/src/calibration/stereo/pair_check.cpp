#include "calibration/stereo/pair_check.hpp"

#include <cmath>
#include <opencv2/calib3d.hpp>

#include "calibration/least_squares.hpp"
#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

Eigen::VectorXd fitBoardPose(const StereoParameters& camera, const std::vector<cv::Point3d>& board,
                             const BoardPair& pair) {
  const auto residuals = [&](std::size_t, const Eigen::VectorXd&, const Eigen::VectorXd& pose) {
    return reprojection(camera, board, pair, pose);
  };
  return minimise(residuals, Eigen::VectorXd(0), {startPose(camera, board, pair)}).own.front();
}

/// Root of the mean squared distance, two residuals making one point.
double rmsDistance(const Eigen::VectorXd& residuals) {
  return std::sqrt(2 * residuals.squaredNorm() / static_cast<double>(residuals.size()));
}

struct RectifiedPair {
  Corners left, right;
  std::vector<cv::Vec3d> points;  ///< reconstructed, in the rectified left camera [m]
};

RectifiedPair reconstructCorners(const StereoModel& model, const BoardPair& pair) {
  RectifiedPair corners;
  corners.left = rectifyPoints(model.left, pair.left);
  corners.right = rectifyPoints(model.right, pair.right);
  const auto& P = model.left.P;
  for (std::size_t i = 0; i < corners.left.size(); ++i) {
    const double depth = depthOfDisparity(model, corners.left[i].x - corners.right[i].x);
    const double row = 0.5 * (corners.left[i].y + corners.right[i].y);
    corners.points.emplace_back((corners.left[i].x - P(0, 2)) / P(0, 0) * depth, (row - P(1, 2)) / P(1, 1) * depth,
                                depth);
  }
  return corners;
}

double spacingError(const std::vector<cv::Vec3d>& points, const Board& board) {
  double sum = 0;
  int count = 0;
  const int width = board.corners.width;
  const auto compare = [&](int a, int b) {
    sum += std::abs(cv::norm(points[a] - points[b]) - board.square);
    ++count;
  };
  for (int y = 0; y < board.corners.height; ++y)
    for (int x = 0; x < width; ++x) {
      if (x + 1 < width) compare(y * width + x, y * width + x + 1);
      if (y + 1 < board.corners.height) compare(y * width + x, (y + 1) * width + x);
    }
  return sum / count;
}

PairErrors checkPair(const StereoParameters& parameters, const StereoModel& model, const Board& board,
                     const BoardPair& pair) {
  const auto points = board.points();
  const Eigen::VectorXd residuals = reprojection(parameters, points, pair, fitBoardPose(parameters, points, pair));
  const RectifiedPair corners = reconstructCorners(model, pair);
  PairErrors errors;
  errors.name = pair.name;
  errors.left_rms = rmsDistance(residuals.head(residuals.size() / 2));
  errors.right_rms = rmsDistance(residuals.tail(residuals.size() / 2));
  errors.rms = rmsDistance(residuals);
  double squares = 0;
  for (std::size_t i = 0; i < corners.left.size(); ++i) squares += std::pow(corners.left[i].y - corners.right[i].y, 2);
  errors.epipolar_rms = std::sqrt(squares / static_cast<double>(corners.left.size()));
  errors.spacing_error = spacingError(corners.points, board);
  return errors;
}

/// Moves the rectified principal points so that what the middle of each raw image shows stays in the middle.
void centre(const StereoParameters& parameters, const cv::Matx33d& R_left, const cv::Matx33d& R_right,
            cv::Matx34d& P_left, cv::Matx34d& P_right) {
  const cv::Point2d middle(0.5 * (parameters.size.width - 1), 0.5 * (parameters.size.height - 1));
  const auto directionOf = [&](const CameraModel& camera, const cv::Matx33d& R) {
    const cv::Point2d raw = directionsOf(camera, {middle}).front();
    const cv::Vec3d turned = R * cv::Vec3d(raw.x, raw.y, 1);
    return cv::Point2d(turned[0] / turned[2], turned[1] / turned[2]);
  };
  const cv::Point2d left = directionOf(parameters.left(), R_left), right = directionOf(parameters.right(), R_right);
  P_left(0, 2) = middle.x - P_left(0, 0) * left.x;
  P_right(0, 2) = middle.x - P_right(0, 0) * right.x;
  P_left(1, 2) = P_right(1, 2) = middle.y - P_left(1, 1) * 0.5 * (left.y + right.y);
}

}  // namespace

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

double rmsReprojection(const StereoParameters& camera, const std::vector<cv::Point3d>& board, const BoardPair& pair) {
  return rmsDistance(reprojection(camera, board, pair, fitBoardPose(camera, board, pair)));
}

SetErrors summarise(std::vector<PairErrors> pairs) {
  SetErrors errors;
  for (const auto& pair : pairs) {
    errors.reprojection_rms += pair.rms * pair.rms;
    errors.epipolar_rms += pair.epipolar_rms * pair.epipolar_rms;
    errors.spacing_error += pair.spacing_error;
  }
  const auto count = static_cast<double>(pairs.size());
  errors.reprojection_rms = std::sqrt(errors.reprojection_rms / count);
  errors.epipolar_rms = std::sqrt(errors.epipolar_rms / count);
  errors.spacing_error /= count;
  errors.pairs = std::move(pairs);
  return errors;
}

StereoModel rectify(const StereoParameters& parameters) {
  const cv::Vec3d& t = parameters.t_right_left;
  if (!(t[0] < 0) || std::abs(t[1]) > std::abs(t[0]))
    throw CalibrationError("the right camera is at " +
                           cortshift_flow::formatted("x = %.4f m, y = %.4f m", -t[0], -t[1]) +
                           " seen from the left one; it must be to the right of it: are left and right swapped, or the "
                           "images rotated?");
  cv::Matx33d R_left, R_right;
  cv::Matx34d P_left, P_right;
  cv::Matx44d Q;
  constexpr double kKeepScale = -1;
  const bool fisheye = parameters.lens == LensModel::kEquidistant;  // which OpenCV's function does not know
  const std::vector<double> none;
  cv::stereoRectify(parameters.K_left, fisheye ? none : parameters.D_left, parameters.K_right,
                    fisheye ? none : parameters.D_right, parameters.size, parameters.R_right_left,
                    parameters.t_right_left, R_left, R_right, P_left, P_right, Q, 0, kKeepScale);
  if (fisheye) centre(parameters, R_left, R_right, P_left, P_right);
  StereoModel model{{parameters.size, parameters.K_left, parameters.lens, parameters.D_left, R_left, P_left},
                    {parameters.size, parameters.K_right, parameters.lens, parameters.D_right, R_right, P_right}};
  model.validate();
  return model;
}

SetErrors checkPairs(const StereoParameters& parameters, const Board& board, const std::vector<BoardPair>& pairs) {
  if (pairs.empty()) throw CalibrationError("no pairs to check the calibration on; give at least one");
  const StereoModel model = rectify(parameters);
  std::vector<PairErrors> errors;
  for (const auto& pair : pairs) errors.push_back(checkPair(parameters, model, board, pair));
  return summarise(std::move(errors));
}

}  // namespace cortshift_stereo
