#include "calibration/stereo/lens_fits.hpp"

#include <algorithm>
#include <iterator>

#include "calibration/stereo/board_fit.hpp"
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
const char* const kEquidistantTerms[] = {"k1", "k1 k2", "k1 k2 k3", "k1 k2 k3 k4"};
const cv::TermCriteria kUntilSettled(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 60, 1e-9);

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
    for (int terms = 1; terms <= static_cast<int>(std::size(kEquidistantTerms)); ++terms)
      fits.push_back({kEquidistantTerms[terms - 1],
                      [terms](const Board& board, const std::vector<BoardPair>& pairs, const StereoParameters& start) {
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
