#include "cortshift_stereo/calibration/hand_eye/hand_eye.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/calib3d.hpp>

#include "calibration/least_squares.hpp"
#include "calibration/outliers.hpp"
#include "calibration/rigid.hpp"

namespace cortshift_stereo {
namespace {

struct Method {
  const char* name;
  cv::HandEyeCalibrationMethod id;
};
const Method kMethods[] = {{"Tsai", cv::CALIB_HAND_EYE_TSAI},
                           {"Park", cv::CALIB_HAND_EYE_PARK},
                           {"Horaud", cv::CALIB_HAND_EYE_HORAUD},
                           {"Andreff", cv::CALIB_HAND_EYE_ANDREFF},
                           {"Daniilidis", cv::CALIB_HAND_EYE_DANIILIDIS}};
constexpr double kOutlierFloorPx = 1.0;    // fit of a board to its corners; no view below is called an outlier
constexpr double kGrossFloor = 1e-3;       // [m] where a view puts the board
constexpr double kGrossTimes = 5;          // tracker noise alone brings good views to three times the median
constexpr double kOutlierFloorSigmas = 5;  // correction of a tracked pose
constexpr double kLargestMisfit = 5;       // corrections may be this many times what the tracker's accuracy explains
constexpr double kDegrees = 180 / CV_PI;
constexpr std::size_t kFewestMethods = 3;
const std::string kNotTogether =
    "the tracked poses and the images do not belong together. Are they poses of the microscope in the reference frame "
    "(not the inverse), in metres, each with its own image, and did the board stay where it was?";

/// A view and the pose of the board that its image alone gives.
struct LocatedView {
  HandEyeView view;
  cv::Affine3d T_left_board;
  double fit_px = 0;
};

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

LocatedView locate(const CameraModel& left, const std::vector<cv::Point3d>& board, const HandEyeView& view) {
  if (view.corners.size() != board.size())
    throw CalibrationError("view " + view.name + " has " + std::to_string(view.corners.size()) +
                           " corners, the board has " + std::to_string(board.size()) + "; find them again");
  cv::Vec3d turn, shift;
  if (!cv::solvePnP(board, view.corners, left.K, left.D, turn, shift))
    throw CalibrationError("view " + view.name + ": no pose of the board fits its corners; take the view out");
  Corners projected;
  cv::projectPoints(board, turn, shift, left.K, left.D, projected);
  double squares = 0;
  for (std::size_t i = 0; i < board.size(); ++i) {
    const cv::Point2d miss = projected[i] - view.corners[i];
    squares += miss.dot(miss);
  }
  return {view, {turn, shift}, std::sqrt(squares / static_cast<double>(board.size()))};
}

/// None where the method finds no rotation in the views.
std::optional<cv::Affine3d> solveClosedForm(const std::vector<LocatedView>& views,
                                            cv::HandEyeCalibrationMethod method) {
  std::vector<cv::Mat> R_reference_microscope, t_reference_microscope, R_left_board, t_left_board;
  for (const auto& located : views) {
    R_reference_microscope.emplace_back(located.view.T_reference_microscope.rotation());
    t_reference_microscope.emplace_back(located.view.T_reference_microscope.translation());
    R_left_board.emplace_back(located.T_left_board.rotation());
    t_left_board.emplace_back(located.T_left_board.translation());
  }
  cv::Mat R, t;
  try {
    cv::calibrateHandEye(R_reference_microscope, t_reference_microscope, R_left_board, t_left_board, R, t, method);
  } catch (const cv::Exception&) {  // its way to say that the equations have no rotation for a solution
    return std::nullopt;
  }
  if (!cv::checkRange(R) || !cv::checkRange(t)) return std::nullopt;
  return cv::Affine3d(cv::Matx33d(R), cv::Vec3d(t));
}

/// The board's corners as each view puts them into the reference frame, given the camera's pose in the microscope.
class BoardInReference {
 public:
  BoardInReference(const std::vector<cv::Point3d>& board, const cv::Affine3d& T_microscope_left,
                   const std::vector<LocatedView>& views)
      : board_(board), T_microscope_left_(T_microscope_left) {
    std::vector<std::vector<cv::Point3d>> placed;
    for (const auto& located : views) placed.push_back(place(located));
    for (std::size_t i = 0; i < board.size(); ++i) {
      std::vector<double> x, y, z;
      for (const auto& points : placed) {
        x.push_back(points[i].x);
        y.push_back(points[i].y);
        z.push_back(points[i].z);
      }
      typical_.emplace_back(median(x), median(y), median(z));
    }
  }

  /// Root mean square distance of a view's corners from the typical ones [m].
  double distance(const LocatedView& located) const {
    const auto points = place(located);
    double squares = 0;
    for (std::size_t i = 0; i < points.size(); ++i) squares += (points[i] - typical_[i]).dot(points[i] - typical_[i]);
    return std::sqrt(squares / static_cast<double>(points.size()));
  }

  std::vector<double> distances(const std::vector<LocatedView>& views) const {
    std::vector<double> all;
    for (const auto& located : views) all.push_back(distance(located));
    return all;
  }

 private:
  std::vector<cv::Point3d> place(const LocatedView& located) const {
    const cv::Affine3d T_reference_board =
        located.view.T_reference_microscope * T_microscope_left_ * located.T_left_board;
    std::vector<cv::Point3d> points;
    for (const auto& corner : board_) points.push_back(T_reference_board * corner);
    return points;
  }

  const std::vector<cv::Point3d>& board_;
  cv::Affine3d T_microscope_left_;
  std::vector<cv::Point3d> typical_;
};

double meanSquare(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value * value;
  return sum / static_cast<double>(values.size());
}

void requireEnough(const std::vector<LocatedView>& views, const std::vector<RejectedView>& rejected) {
  if (views.size() >= kFewestHandEyeViews) return;
  std::string message = "only " + std::to_string(views.size()) + " usable views; at least " +
                        std::to_string(kFewestHandEyeViews) +
                        " with the microscope turned about different axes are needed: take more";
  for (const auto& view : rejected) message += "\n  " + view.name + ": " + view.reason;
  throw CalibrationError(message);
}

void reject(std::vector<LocatedView>& views, std::size_t at, const std::string& reason,
            std::vector<RejectedView>& rejected) {
  rejected.push_back({views[at].view.name, reason});
  views.erase(views.begin() + static_cast<std::ptrdiff_t>(at));
  requireEnough(views, rejected);
}

/// The views that disagree most under the solution of all.
std::vector<std::size_t> suspects(const std::vector<cv::Point3d>& board, const std::vector<LocatedView>& views) {
  constexpr std::size_t kSuspects = 6;
  const auto T_microscope_left = solveClosedForm(views, cv::CALIB_HAND_EYE_PARK);
  if (!T_microscope_left) throw CalibrationError(kNotTogether);
  const auto distances = BoardInReference(board, *T_microscope_left, views).distances(views);
  std::vector<std::size_t> order(views.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return distances[a] > distances[b]; });
  order.resize(std::min(order.size(), kSuspects));
  return order;
}

/// Leaves each suspect out in turn: a view that spoils the solution differs clearly from the solution without it.
bool rejectWorstPose(const std::vector<cv::Point3d>& board, std::vector<LocatedView>& views,
                     std::vector<RejectedView>& rejected) {
  double best = std::numeric_limits<double>::infinity();
  std::size_t suspect = 0;
  double suspect_distance = 0, typical_distance = 0;
  for (const std::size_t i : suspects(board, views)) {
    auto others = views;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
    const auto T_microscope_left = solveClosedForm(others, cv::CALIB_HAND_EYE_PARK);
    if (!T_microscope_left) continue;
    const BoardInReference placed(board, *T_microscope_left, others);
    const auto distances = placed.distances(others);
    if (!(meanSquare(distances) < best)) continue;
    best = meanSquare(distances);
    suspect = i;
    suspect_distance = placed.distance(views[i]);
    typical_distance = median(distances);
  }
  std::vector<double> values(views.size(), typical_distance);
  values[suspect] = suspect_distance;
  if (!findOutlier(values, kGrossFloor, kGrossTimes)) return false;
  reject(views, suspect,
         "its tracked pose puts the board " + number(suspect_distance * 1e3) +
             " mm from where the other views have it (" + number(typical_distance * 1e3) +
             " mm is typical); did the tracker lose the microscope, or the board move?",
         rejected);
  return true;
}

/// The views whose corners fit the board and whose tracked poses do not grossly disagree.
std::vector<LocatedView> screen(const CameraModel& left, const std::vector<cv::Point3d>& board,
                                const std::vector<HandEyeView>& views, std::vector<RejectedView>& rejected) {
  std::vector<LocatedView> used;
  std::vector<double> fits;
  for (const auto& view : views) {
    used.push_back(locate(left, board, view));
    fits.push_back(used.back().fit_px);
  }
  requireEnough(used, rejected);
  while (const auto worst = findOutlier(fits, kOutlierFloorPx)) {
    reject(used, *worst,
           "the board fits its corners only to " + number(fits[*worst]) + " px; blurred or partly hidden?", rejected);
    fits.erase(fits.begin() + static_cast<std::ptrdiff_t>(*worst));
  }
  while (rejectWorstPose(board, used, rejected)) continue;
  return used;
}

cv::Vec3d rotationDiversity(const std::vector<LocatedView>& views) {
  cv::Matx33d sum = cv::Matx33d::zeros();
  for (const auto& located : views) sum += located.view.T_reference_microscope.rotation();
  const cv::SVD svd(cv::Mat(sum), 0);
  const cv::Matx33d U(svd.u), Vt(svd.vt);
  const double handedness = cv::determinant(U * Vt) < 0 ? -1 : 1;
  const cv::Matx33d mean = U * cv::Matx33d(1, 0, 0, 0, 1, 0, 0, 0, handedness) * Vt;
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& located : views) {
    cv::Vec3d turn;
    cv::Rodrigues(mean.t() * located.view.T_reference_microscope.rotation(), turn);
    const Eigen::Vector3d vector(turn[0], turn[1], turn[2]);
    scatter += vector * vector.transpose() / static_cast<double>(views.size());
  }
  const Eigen::Vector3d squares = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvalues().cwiseMax(0);
  return {std::sqrt(squares(2)), std::sqrt(squares(1)), std::sqrt(squares(0))};
}

std::vector<HandEyeMethodResult> solveByAllMethods(const std::vector<LocatedView>& views) {
  std::vector<HandEyeMethodResult> results;
  for (const auto& method : kMethods)
    if (const auto T_microscope_left = solveClosedForm(views, method.id))
      results.push_back({method.name, *T_microscope_left});
  return results;
}

/// The solution under which the views agree best on where the board is.
cv::Affine3d bestStart(const std::vector<cv::Point3d>& board, const std::vector<HandEyeMethodResult>& methods,
                       const std::vector<LocatedView>& views) {
  const auto error = [&](const HandEyeMethodResult& method) {
    return meanSquare(BoardInReference(board, method.T_microscope_left, views).distances(views));
  };
  return std::min_element(methods.begin(), methods.end(),
                          [&](const auto& a, const auto& b) { return error(a) < error(b); })
      ->T_microscope_left;
}

/// The maximum-likelihood estimate: shared are small motions of the camera in the microscope and of the board in the
/// reference frame, each view's own is the correction of its tracked pose.
struct Refinement {
  cv::Affine3d T_microscope_left, T_reference_board;
  LeastSquaresSolution solution;
};

class Refiner {
 public:
  Refiner(const CameraModel& left, const std::vector<cv::Point3d>& board, const HandEyeSettings& settings)
      : left_(left), board_(board), settings_(settings) {}

  Refinement refine(const std::vector<LocatedView>& views, const cv::Affine3d& T_microscope_left,
                    const cv::Affine3d& T_reference_board) const {
    const auto residuals = [&](std::size_t view, const Eigen::VectorXd& shared, const Eigen::VectorXd& own) {
      const Eigen::VectorXd misses =
          reprojection(views[view].view, T_microscope_left * transformFromVector(shared.head(6)),
                       T_reference_board * transformFromVector(shared.tail(6)), transformFromVector(own));
      Eigen::VectorXd all(misses.size() + 6);
      all << misses / settings_.corner_sd, own.head(3) / settings_.tracker_rotation_sd,
          own.tail(3) / settings_.tracker_position_sd;
      return all;
    };
    Refinement refinement;
    refinement.solution = minimise(residuals, Eigen::VectorXd::Zero(12),
                                   std::vector<Eigen::VectorXd>(views.size(), Eigen::VectorXd::Zero(6)));
    const auto& shared = refinement.solution.shared;
    refinement.T_microscope_left = T_microscope_left * transformFromVector(shared.head(6));
    refinement.T_reference_board = T_reference_board * transformFromVector(shared.tail(6));
    return refinement;
  }

  /// Distances of the projected board from the corners [px], x and y in turn.
  Eigen::VectorXd reprojection(const HandEyeView& view, const cv::Affine3d& T_microscope_left,
                               const cv::Affine3d& T_reference_board, const cv::Affine3d& correction) const {
    const cv::Affine3d T_left_board =
        (view.T_reference_microscope * correction * T_microscope_left).inv() * T_reference_board;
    Corners projected;
    cv::projectPoints(board_, T_left_board.rvec(), T_left_board.translation(), left_.K, left_.D, projected);
    Eigen::VectorXd misses(2 * static_cast<Eigen::Index>(projected.size()));
    for (std::size_t i = 0; i < projected.size(); ++i)
      misses.segment<2>(2 * static_cast<Eigen::Index>(i)) << projected[i].x - view.corners[i].x,
          projected[i].y - view.corners[i].y;
    return misses;
  }

  /// Length of a correction in standard deviations of the tracker, per degree of freedom.
  double sigmas(const Eigen::VectorXd& correction) const {
    return std::sqrt(((correction.head(3) / settings_.tracker_rotation_sd).squaredNorm() +
                      (correction.tail(3) / settings_.tracker_position_sd).squaredNorm()) /
                     6);
  }

 private:
  const CameraModel& left_;
  const std::vector<cv::Point3d>& board_;
  const HandEyeSettings& settings_;
};

void reportResiduals(const Refiner& refiner, const Refinement& refined, const std::vector<LocatedView>& used,
                     HandEyeCalibration& result) {
  double residual_count = -12;
  double squares = 0, corners = 0;
  for (std::size_t i = 0; i < used.size(); ++i) {
    const auto& own = refined.solution.own[i];
    const Eigen::VectorXd misses = refiner.reprojection(used[i].view, result.T_microscope_left,
                                                        result.T_reference_board, cv::Affine3d::Identity());
    const double count = static_cast<double>(misses.size()) / 2;
    result.residuals.push_back(
        {used[i].view.name, std::sqrt(misses.squaredNorm() / count), own.tail(3).norm(), own.head(3).norm()});
    squares += misses.squaredNorm();
    corners += count;
    residual_count += static_cast<double>(misses.size());  // six more residuals and six more parameters per view
  }
  result.reprojection_rms = std::sqrt(squares / corners);
  const Eigen::VectorXd variances = refined.solution.covariance.diagonal() * (refined.solution.cost / residual_count);
  for (int i = 0; i < 3; ++i) {
    result.rotation_sd[i] = std::sqrt(std::max(0.0, variances(i)));
    result.position_sd[i] = std::sqrt(std::max(0.0, variances(3 + i)));
  }
}

void compareMethods(HandEyeCalibration& result) {
  for (auto& method : result.methods) {
    const cv::Affine3d difference = result.T_microscope_left.inv() * method.T_microscope_left;
    method.translation_difference = cv::norm(difference.translation());
    method.rotation_difference = cv::norm(difference.rvec());
    for (const auto& other : result.methods)
      result.method_spread = std::max(result.method_spread, cv::norm(method.T_microscope_left.translation() -
                                                                     other.T_microscope_left.translation()));
  }
}

void requireRotation(const cv::Vec3d& diversity) {
  if (diversity[1] >= kLeastRotationDiversity) return;
  throw CalibrationError("the microscope was turned by only " + number(diversity[1] * kDegrees) +
                         " degrees RMS about a second axis (" + number(diversity[0] * kDegrees) +
                         " about the first); at least " + number(kLeastRotationDiversity * kDegrees) +
                         " are needed: add views turned about other axes");
}

void requireRange(double value, const char* name, double low, double high, const char* unit) {
  if (!(value >= low && value <= high))
    throw CalibrationError(std::string(name) + " is " + number(value) + " " + unit + "; allowed is " + number(low) +
                           " to " + number(high) + " " + unit);
}

}  // namespace

void HandEyeSettings::validate() const {
  requireRange(tracker_position_sd, "tracker_position_sd", 1e-6, 0.02, "m");
  requireRange(tracker_rotation_sd, "tracker_rotation_sd", 1e-6, 0.1, "rad");
  requireRange(corner_sd, "corner_sd", 1e-3, 10, "px");
}

HandEyeCalibration calibrateHandEye(const CameraModel& left, const Board& board, const std::vector<HandEyeView>& views,
                                    const HandEyeSettings& settings) {
  settings.validate();
  if (board.looksTheSameUpsideDown())
    throw CalibrationError(
        "board " + board.name() +
        " looks the same upside down, so its pose is not determined when the microscope turns; use one "
        "with an odd and an even count of inner corners, such as 9x6");
  const auto points = board.points();
  HandEyeCalibration result;
  std::vector<LocatedView> used = screen(left, points, views, result.rejected);

  const Refiner refiner(left, points, settings);
  Refinement refined;
  for (bool settled = false; !settled;) {
    result.rotation_diversity = rotationDiversity(used);
    requireRotation(result.rotation_diversity);
    result.methods = solveByAllMethods(used);
    if (result.methods.size() < kFewestMethods) throw CalibrationError(kNotTogether);
    const cv::Affine3d start = bestStart(points, result.methods, used);
    const cv::Affine3d board_start = used.front().view.T_reference_microscope * start * used.front().T_left_board;
    refined = refiner.refine(used, start, board_start);

    std::vector<double> corrections;
    for (const auto& own : refined.solution.own) corrections.push_back(refiner.sigmas(own));
    const auto worst = findOutlier(corrections, kOutlierFloorSigmas);
    settled = !worst;
    if (worst) {
      const auto& own = refined.solution.own[*worst];
      reject(used, *worst,
             "its image asks for a pose " + number(own.tail(3).norm() * 1e3) + " mm and " +
                 number(own.head(3).norm() * kDegrees) +
                 " degrees from the tracked one; did the microscope still move?",
             result.rejected);
    } else if (!refined.solution.converged || !(std::sqrt(meanSquare(corrections)) <= kLargestMisfit)) {
      throw CalibrationError(kNotTogether +
                             (" (they would have to be off by " + number(std::sqrt(meanSquare(corrections))) +
                              " times the tracker's accuracy)"));
    }
  }

  result.T_microscope_left = refined.T_microscope_left;
  result.T_reference_board = refined.T_reference_board;
  reportResiduals(refiner, refined, used, result);
  compareMethods(result);
  return result;
}

}  // namespace cortshift_stereo
