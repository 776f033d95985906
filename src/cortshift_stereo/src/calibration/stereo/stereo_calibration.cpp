#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "calibration/outliers.hpp"
#include "calibration/stereo/lens_fits.hpp"
#include "calibration/stereo/pair_check.hpp"
#include "cortshift_flow/text.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::formatted;

constexpr double kWorthATerm = 1.01;  // a simpler model may be this much worse on held-out pairs
constexpr std::size_t kFolds = 6;
constexpr double kOutlierFloorPx = 0.75;    // no view below is called an outlier
constexpr double kOutlierFloorPose = 0.05;  // of the relative pose: radians, and share of the board's distance
constexpr double kLargestFocalDeviation = 0.02;
constexpr double kLeastTilt = 8 * CV_PI / 180;

/// Root mean square angle between the boards' normals and the optical axis [rad].
double rmsTilt(const SingleCamera& camera) {
  double squares = 0;
  for (const auto& turn : camera.turns) {
    const cv::Matx33d R = rotationOf(turn);
    squares += std::pow(std::atan2(std::hypot(R(0, 2), R(1, 2)), std::abs(R(2, 2))), 2);
  }
  return std::sqrt(squares / static_cast<double>(camera.turns.size()));
}

/// Share of the way from the middle to a corner of the image that the boards' corners reach in the worst quarter.
double reachOf(const std::vector<std::vector<cv::Point2f>>& seen, const cv::Size& size) {
  const cv::Point2d middle(0.5 * (size.width - 1), 0.5 * (size.height - 1));
  double reach[4] = {0, 0, 0, 0};
  for (const auto& corners : seen)
    for (const auto& corner : corners) {
      const cv::Point2d from_middle = cv::Point2d(corner) - middle;
      double& quarter = reach[2 * (from_middle.y > 0) + (from_middle.x > 0)];
      quarter = std::max(quarter, cv::norm(from_middle) / cv::norm(middle));
    }
  return *std::min_element(std::begin(reach), std::end(reach));
}

double rmsOf(const std::vector<double>& values) {
  double squares = 0;
  for (const double value : values) squares += value * value;
  return std::sqrt(squares / static_cast<double>(values.size()));
}

/// What the verdict wants to know of each camera alone.
void describeCamerasAlone(const Board& board, const cv::Size& size, const std::vector<BoardPair>& pairs,
                          StereoCalibration& calibration) {
  const PointLists points(board, pairs);
  const SingleCamera left = calibrateOne(points.board, points.left, size, kTangentialLens);
  const SingleCamera right = calibrateOne(points.board, points.right, size, kTangentialLens);
  calibration.left_alone_rms = rmsOf(left.view_rms);
  calibration.right_alone_rms = rmsOf(right.view_rms);
  calibration.reach = std::min(reachOf(points.left, size), reachOf(points.right, size));
  std::vector<double> distances;
  for (const auto& shift : left.shifts) distances.push_back(cv::norm(shift));
  calibration.distance = median(distances);
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
    return {calibrateOne(points.board, points.left, size_, kPaperLens),
            calibrateOne(points.board, points.right, size_, kPaperLens)};
  }

  bool rejectBySide(const std::string& side, std::vector<std::vector<cv::Point2f>> PointLists::*seen) {
    const PointLists points(board_, pairs_);
    const auto errors = calibrateOne(points.board, points.*seen, size_, kPaperLens).view_rms;
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
          "left one than in the other views; are the two images of the same moment, and is neither mirrored?");
    });
  }

  bool rejectByJointFit() {
    const auto parameters = calibrateBoth(PointLists(board_, pairs_), start(), kRadialLens);
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
                        const JointFit& fit, const std::function<void()>& fold_done) {
  const std::size_t folds = std::min(kFolds, pairs.size());
  std::vector<PairErrors> errors;
  for (std::size_t fold = 0; fold < folds; ++fold) {
    std::vector<BoardPair> kept, held_out;
    for (std::size_t i = 0; i < pairs.size(); ++i) (i % folds == fold ? held_out : kept).push_back(pairs[i]);
    const auto parameters = fit(board, kept, start);
    for (const auto& pair : checkPairs(parameters, board, held_out).pairs) errors.push_back(pair);
    fold_done();
  }
  std::sort(errors.begin(), errors.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  return summarise(std::move(errors));
}

}  // namespace

StereoCalibration calibrateStereo(const Board& board, const cv::Size& size, const std::vector<BoardPair>& pairs,
                                  const std::function<void(double)>& progress, LensModel lens) {
  const Screening screening(board, size, pairs);
  StereoCalibration calibration;
  calibration.rejected = calibration.screened = screening.rejected();
  calibration.focal_deviation = screening.focalDeviation();
  if (!(calibration.focal_deviation <= kLargestFocalDeviation))
    throw CalibrationError(
        "the views determine a focal length only to " +
        formatted("%.1f %% (limit %.0f %%)", 100 * calibration.focal_deviation, 100 * kLargestFocalDeviation) +
        "; the boards are too parallel: take views tilted by 20 to 40 degrees in all directions");

  const StereoParameters start = screening.start();
  const auto fits = fitsOf(lens);
  const double steps = static_cast<double>(fits.size() * std::min(kFolds, screening.pairs().size()));
  int done = 0;
  const auto fold_done = [&] {
    if (progress) progress(++done / steps);
  };
  double best = std::numeric_limits<double>::infinity();
  for (const auto& candidate : fits) {
    calibration.scores.push_back(
        {candidate.name, crossValidate(board, screening.pairs(), start, candidate.fit, fold_done)});
    best = std::min(best, calibration.scores.back().held_out.reprojection_rms);
  }
  std::size_t chosen = 0;
  while (calibration.scores[chosen].held_out.reprojection_rms > kWorthATerm * best) ++chosen;
  calibration.model = fits[chosen].name;
  calibration.parameters = fits[chosen].fit(board, screening.pairs(), start);
  describeCamerasAlone(board, size, screening.pairs(), calibration);
  calibration.used = checkPairs(calibration.parameters, board, screening.pairs());
  return calibration;
}

}  // namespace cortshift_stereo
