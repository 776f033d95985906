#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "calibration/outliers.hpp"
#include "calibration/stereo/pair_check.hpp"
#include "cortshift_flow/text.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::formatted;

struct Candidate {
  const char* name;
  int flags;
};
const Candidate kCandidates[] = {
    {"k1", cv::CALIB_FIX_K2 | cv::CALIB_FIX_K3 | cv::CALIB_ZERO_TANGENT_DIST},
    {"k1 k2", cv::CALIB_FIX_K3 | cv::CALIB_ZERO_TANGENT_DIST},
    {"k1 k2 p1 p2", cv::CALIB_FIX_K3},
    {"k1 k2 p1 p2 k3", 0},
};
constexpr double kWorthATerm = 1.01;  // a simpler model may be this much worse on held-out pairs
constexpr std::size_t kFolds = 6;
constexpr double kOutlierFloorPx = 0.75;    // no view below is called an outlier
constexpr double kOutlierFloorPose = 0.05;  // of the relative pose: radians, and share of the board's distance
constexpr double kLargestFocalDeviation = 0.02;
constexpr double kLeastTilt = 8 * CV_PI / 180;
const cv::TermCriteria kUntilSettled(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 60, 1e-9);

/// Point lists as OpenCV's calibration wants them.
struct PointLists {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> left, right;

  PointLists(const Board& shape, const std::vector<BoardPair>& pairs) {
    const auto points = shape.points();
    for (const auto& pair : pairs) {
      board.emplace_back(points.begin(), points.end());
      left.emplace_back(pair.left.begin(), pair.left.end());
      right.emplace_back(pair.right.begin(), pair.right.end());
    }
  }
};

/// One camera alone.
struct SingleCamera {
  cv::Matx33d K;
  std::vector<double> D;
  std::vector<cv::Mat> turns, shifts;                                ///< the board's pose per view
  std::vector<double> view_rms;                                      ///< [px]
  double focal_deviation = std::numeric_limits<double>::infinity();  ///< relative
};

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

/// Root mean square angle between the boards' normals and the optical axis [rad].
double rmsTilt(const SingleCamera& camera) {
  double squares = 0;
  for (const auto& turn : camera.turns) {
    const cv::Matx33d R = rotationOf(turn);
    squares += std::pow(std::atan2(std::hypot(R(0, 2), R(1, 2)), std::abs(R(2, 2))), 2);
  }
  return std::sqrt(squares / static_cast<double>(camera.turns.size()));
}

double angleBetween(const cv::Matx33d& a, const cv::Matx33d& b) {
  cv::Vec3d turn;
  cv::Rodrigues(a * b.t(), turn);
  return cv::norm(turn);
}

/// The pairs that agree with each other, and a start for the joint fit.
class Screening {
 public:
  Screening(const Board& board, const cv::Size& size, std::vector<BoardPair> pairs)
      : board_(board), size_(size), pairs_(std::move(pairs)) {
    requireEnough();
    while (rejectBySide("left", &PointLists::left) || rejectBySide("right", &PointLists::right)) continue;
    requireTilt();
    while (rejectByRelativePose()) continue;
    while (rejectByJointFit()) continue;
  }

  const std::vector<BoardPair>& pairs() const { return pairs_; }
  const std::vector<RejectedView>& rejected() const { return rejected_; }

  /// Each camera by itself with the fewest terms; R and t are not used by the joint fit.
  StereoParameters start() const {
    const auto [left, right] = singleCameras();
    StereoParameters start;
    start.size = size_;
    start.K_left = left.K;
    start.K_right = right.K;
    start.D_left = left.D;
    start.D_right = right.D;
    return start;
  }

  double focalDeviation() const {
    const auto [left, right] = singleCameras();
    return std::max(left.focal_deviation, right.focal_deviation);
  }

 private:
  std::pair<SingleCamera, SingleCamera> singleCameras() const {
    const PointLists points(board_, pairs_);
    return {calibrateOne(points.board, points.left, size_, kCandidates[0].flags),
            calibrateOne(points.board, points.right, size_, kCandidates[0].flags)};
  }

  bool rejectBySide(const std::string& side, std::vector<std::vector<cv::Point2f>> PointLists::*seen) {
    const PointLists points(board_, pairs_);
    const auto errors = calibrateOne(points.board, points.*seen, size_, kCandidates[0].flags).view_rms;
    return rejectWorst(errors, kOutlierFloorPx, [&](double error, double typical) {
      return side + " corners are off by " + formatted("%.2f px RMS where %.2f px is typical", error, typical) +
             "; is the image blurred, or the board bent or partly hidden?";
    });
  }

  /// The cameras do not move in their head: the pose of one in the other must be the same in every view.
  bool rejectByRelativePose() {
    const auto [left, right] = singleCameras();
    std::vector<cv::Matx33d> rotations;
    std::vector<cv::Vec3d> shifts;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      rotations.push_back(rotationOf(right.turns[i]) * rotationOf(left.turns[i]).t());
      shifts.push_back(cv::Vec3d(right.shifts[i]) - rotations.back() * cv::Vec3d(left.shifts[i]));
    }
    std::vector<double> differences;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      std::vector<double> to_others;
      for (std::size_t j = 0; j < pairs_.size(); ++j)
        if (j != i)
          to_others.push_back(std::max(angleBetween(rotations[i], rotations[j]),
                                       cv::norm(shifts[i] - shifts[j]) / cv::norm(cv::Vec3d(left.shifts[i]))));
      differences.push_back(median(to_others));
    }
    return rejectWorst(differences, kOutlierFloorPose, [](double, double) {
      return std::string(
          "left and right corners do not fit one another: with them the right camera would have another pose in the "
          "left one than in the other views; are the two images of the same moment?");
    });
  }

  bool rejectByJointFit() {
    const auto parameters = calibrateBoth(PointLists(board_, pairs_), start(), kCandidates[1].flags);
    const auto points = board_.points();
    std::vector<double> errors;
    for (const auto& pair : pairs_) errors.push_back(rmsReprojection(parameters, points, pair));
    return rejectWorst(errors, kOutlierFloorPx, [](double error, double typical) {
      return formatted("reprojection error is %.2f px RMS where %.2f px is typical", error, typical) +
             "; did the board move between the two images?";
    });
  }

  template <typename Reason>
  bool rejectWorst(const std::vector<double>& values, double floor, const Reason& reason) {
    const auto worst = findOutlier(values, floor);
    if (!worst) return false;
    rejected_.push_back({pairs_[*worst].name, reason(values[*worst], median(values))});
    pairs_.erase(pairs_.begin() + static_cast<std::ptrdiff_t>(*worst));
    requireEnough();
    return true;
  }

  /// Boards that all face the camera do not determine its focal length. The deviations that OpenCV reports do not show
  /// it: at 1 degree of tilt they say 0.01 % where the focal length is wrong by a factor of three; at 10 degrees both
  /// are 0.4 %.
  void requireTilt() const {
    const auto [left, right] = singleCameras();
    for (const auto* camera : {&left, &right}) {
      const double tilt = rmsTilt(*camera);
      if (!(tilt >= kLeastTilt) || !(camera->focal_deviation <= kLargestFocalDeviation))
        throw CalibrationError("the boards are too parallel to the image to determine the focal length: " +
                               formatted("tilted by %.1f degrees RMS, at least %.0f are needed", tilt * 180 / CV_PI,
                                         kLeastTilt * 180 / CV_PI) +
                               "; take views tilted by 20 to 40 degrees in all directions");
    }
  }

  void requireEnough() const {
    if (pairs_.size() >= kFewestPairs) return;
    std::string message = "only " + std::to_string(pairs_.size()) + " usable pairs; at least " +
                          std::to_string(kFewestPairs) + " with the board at different tilts are needed: take more";
    for (const auto& view : rejected_) message += "\n  " + view.name + ": " + view.reason;
    throw CalibrationError(message);
  }

  Board board_;
  cv::Size size_;
  std::vector<BoardPair> pairs_;
  std::vector<RejectedView> rejected_;
};

SetErrors crossValidate(const Board& board, const std::vector<BoardPair>& pairs, const StereoParameters& start,
                        int flags, const std::function<void()>& fold_done) {
  const std::size_t folds = std::min(kFolds, pairs.size());
  std::vector<PairErrors> errors;
  for (std::size_t fold = 0; fold < folds; ++fold) {
    std::vector<BoardPair> kept, held_out;
    for (std::size_t i = 0; i < pairs.size(); ++i) (i % folds == fold ? held_out : kept).push_back(pairs[i]);
    const auto parameters = calibrateBoth(PointLists(board, kept), start, flags);
    for (const auto& pair : checkPairs(parameters, board, held_out).pairs) errors.push_back(pair);
    fold_done();
  }
  std::sort(errors.begin(), errors.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  return summarise(std::move(errors));
}

}  // namespace

StereoCalibration calibrateStereo(const Board& board, const cv::Size& size, const std::vector<BoardPair>& pairs,
                                  const std::function<void(double)>& progress) {
  const Screening screening(board, size, pairs);
  StereoCalibration calibration;
  calibration.rejected = screening.rejected();
  calibration.focal_deviation = screening.focalDeviation();
  if (!(calibration.focal_deviation <= kLargestFocalDeviation))
    throw CalibrationError(
        "the views determine a focal length only to " +
        formatted("%.1f %% (limit %.0f %%)", 100 * calibration.focal_deviation, 100 * kLargestFocalDeviation) +
        "; the boards are too parallel: take views tilted by 20 to 40 degrees in all directions");

  const StereoParameters start = screening.start();
  const double steps = static_cast<double>(std::size(kCandidates) * std::min(kFolds, screening.pairs().size()));
  int done = 0;
  const auto fold_done = [&] {
    if (progress) progress(++done / steps);
  };
  double best = std::numeric_limits<double>::infinity();
  for (const auto& candidate : kCandidates) {
    calibration.scores.push_back(
        {candidate.name, crossValidate(board, screening.pairs(), start, candidate.flags, fold_done)});
    best = std::min(best, calibration.scores.back().held_out.reprojection_rms);
  }
  std::size_t chosen = 0;
  while (calibration.scores[chosen].held_out.reprojection_rms > kWorthATerm * best) ++chosen;
  calibration.model = kCandidates[chosen].name;
  calibration.parameters = calibrateBoth(PointLists(board, screening.pairs()), start, kCandidates[chosen].flags);
  calibration.used = checkPairs(calibration.parameters, board, screening.pairs());
  return calibration;
}

}  // namespace cortshift_stereo
