#include "calibration/stereo/lens_fits.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include "calibration/least_squares.hpp"
#include "calibration/stereo/pair_check.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

/// Which terms of a lens are not held at 0.
struct Candidate {
  const char* name;
  int flags;  ///< of OpenCV's calibration
};
const Candidate kCandidates[] = {
    {"k1", kPaperLens},
    {"k1 k2", kRadialLens},
    {"k1 k2 p1 p2", kTangentialLens},
    {"k1 k2 p1 p2 k3", 0},
};
const Candidate kRational{"k1 k2 p1 p2 k3 k4 k5 k6", cv::CALIB_RATIONAL_MODEL};
const std::pair<const char*, int> kEquidistantTerms[] = {{"k1", 1}, {"k1 k2", 2}, {"k1 k2 k3 k4", 4}};
const cv::TermCriteria kUntilSettled(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 60, 1e-9);

constexpr Eigen::Index kIntrinsics = 4;

/// Changes of one camera: focal lengths and principal point in shares of the focal length, then the terms that are
/// free.
void change(const Eigen::VectorXd& by, Eigen::Index from, int terms, cv::Matx33d& K, std::vector<double>& D) {
  const double focal = K(0, 0);
  K(0, 0) += focal * by(from);
  K(1, 1) += focal * by(from + 1);
  K(0, 2) += focal * by(from + 2);
  K(1, 2) += focal * by(from + 3);
  for (int i = 0; i < terms; ++i) D.at(static_cast<std::size_t>(i)) += by(from + kIntrinsics + i);
}

/// Both cameras with equidistant lenses and their relative pose, all together by least squares: OpenCV's own
/// calibration of fisheyes gives up on the small fields of microscopes, where its terms hardly differ.
/// @param start  plumb_bob fitted to the same pairs
/// @param terms  1 to 4 coefficients are estimated, the others are 0
StereoParameters fitEquidistant(const std::vector<cv::Point3d>& board, const std::vector<BoardPair>& pairs,
                                const StereoParameters& start, int terms) {
  StereoParameters first = start;
  first.lens = LensModel::kEquidistant;
  // The tangent of the angle bends by a^3 / 3 where the angle itself does not.
  first.D_left = {start.D_left[0] + 1.0 / 3, 0, 0, 0};
  first.D_right = {start.D_right[0] + 1.0 / 3, 0, 0, 0};
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

}  // namespace

PointLists::PointLists(const Board& shape, const std::vector<BoardPair>& pairs) {
  const auto points = shape.points();
  for (const auto& pair : pairs) {
    board.emplace_back(points.begin(), points.end());
    left.emplace_back(pair.left.begin(), pair.left.end());
    right.emplace_back(pair.right.begin(), pair.right.end());
  }
}

SingleCamera calibrateOne(const std::vector<std::vector<cv::Point3f>>& board,
                          const std::vector<std::vector<cv::Point2f>>& seen, const cv::Size& size, int flags) {
  SingleCamera camera;
  cv::Mat K, D, deviations, pose_deviations, errors;
  cv::calibrateCamera(board, seen, size, K, D, camera.turns, camera.shifts, deviations, pose_deviations, errors, flags);
  camera.K = K;
  D.reshape(1, 1).copyTo(camera.D);
  errors.reshape(1, 1).copyTo(camera.view_rms);
  const double fx = camera.K(0, 0), fy = camera.K(1, 1);
  if (fx > 0 && fy > 0) camera.focal_deviation = std::max(deviations.at<double>(0) / fx, deviations.at<double>(1) / fy);
  return camera;
}

StereoParameters calibrateBoth(const PointLists& points, const StereoParameters& start, int flags) {
  StereoParameters fitted = start;
  cv::Mat K_left(start.K_left), K_right(start.K_right), D_left(start.D_left, true), D_right(start.D_right, true);
  cv::Mat R, t, essential, fundamental;
  cv::stereoCalibrate(points.board, points.left, points.right, K_left, D_left, K_right, D_right, start.size, R, t,
                      essential, fundamental, flags | cv::CALIB_USE_INTRINSIC_GUESS, kUntilSettled);
  fitted.K_left = K_left;
  fitted.K_right = K_right;
  D_left.reshape(1, 1).copyTo(fitted.D_left);
  D_right.reshape(1, 1).copyTo(fitted.D_right);
  fitted.R_right_left = R;
  fitted.t_right_left = t;
  return fitted;
}

std::vector<NamedFit> fitsOf(LensModel lens) {
  std::vector<NamedFit> fits;
  if (lens == LensModel::kEquidistant) {
    for (const auto& candidate : kEquidistantTerms)
      fits.push_back(
          {candidate.first, [terms = candidate.second](const Board& board, const std::vector<BoardPair>& pairs,
                                                       const StereoParameters& start) {
             const auto near = calibrateBoth(PointLists(board, pairs), start, kRadialLens);
             return fitEquidistant(board.points(), pairs, near, terms);
           }});
    return fits;
  }
  std::vector<Candidate> candidates(std::begin(kCandidates), std::end(kCandidates));
  if (lens == LensModel::kRationalPolynomial) candidates.push_back(kRational);
  for (const Candidate& candidate : candidates)
    fits.push_back({candidate.name, [lens, candidate](const Board& board, const std::vector<BoardPair>& pairs,
                                                      const StereoParameters& start) {
                      auto fitted = calibrateBoth(PointLists(board, pairs), start, candidate.flags);
                      fitted.lens = lens;
                      for (auto* D : {&fitted.D_left, &fitted.D_right}) {
                        if (lens == LensModel::kRationalPolynomial) D->resize(std::max<std::size_t>(D->size(), 8), 0.0);
                        *D = checkedCoefficients(lens, *D, "calibration: D");
                      }
                      return fitted;
                    }});
  return fits;
}

}  // namespace cortshift_stereo
