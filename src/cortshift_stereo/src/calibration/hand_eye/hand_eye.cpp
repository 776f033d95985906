#include "cortshift_stereo/calibration/hand_eye/hand_eye.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "calibration/hand_eye/hand_eye_views.hpp"
#include "calibration/least_squares.hpp"
#include "calibration/outliers.hpp"
#include "calibration/rigid.hpp"
#include "cortshift_flow/range.hpp"
#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::shortNumber;

struct Method {
  const char* name;
  cv::HandEyeCalibrationMethod id;
};
const Method kMethods[] = {{"Tsai", cv::CALIB_HAND_EYE_TSAI},
                           {"Park", cv::CALIB_HAND_EYE_PARK},
                           {"Horaud", cv::CALIB_HAND_EYE_HORAUD},
                           {"Andreff", cv::CALIB_HAND_EYE_ANDREFF},
                           {"Daniilidis", cv::CALIB_HAND_EYE_DANIILIDIS}};
constexpr double kOutlierFloorSigmas = 5;  // correction of a tracked pose
constexpr double kLargestMisfit = 5;       // corrections may be this many times what the tracker's accuracy explains
constexpr double kDegrees = 180 / CV_PI;
constexpr std::size_t kFewestMethods = 3;

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
    const Corners projected = projectPoints(left_, board_, T_left_board.rvec(), T_left_board.translation());
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
  throw CalibrationError("the microscope was turned by only " + shortNumber(diversity[1] * kDegrees) +
                         " degrees RMS about a second axis (" + shortNumber(diversity[0] * kDegrees) +
                         " about the first); at least " + shortNumber(kLeastRotationDiversity * kDegrees) +
                         " are needed: add views turned about other axes");
}

}  // namespace

void HandEyeSettings::validate() const {
  cortshift_flow::requireRange<CalibrationError>("tracker_position_sd [m]", tracker_position_sd, 1e-6, 0.02);
  cortshift_flow::requireRange<CalibrationError>("tracker_rotation_sd [rad]", tracker_rotation_sd, 1e-6, 0.1);
  cortshift_flow::requireRange<CalibrationError>("corner_sd [px]", corner_sd, 1e-3, 10.0);
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
             "its image asks for a pose " + shortNumber(own.tail(3).norm() * 1e3) + " mm and " +
                 shortNumber(own.head(3).norm() * kDegrees) +
                 " degrees from the tracked one; did the microscope still move?",
             result.rejected);
    } else if (!refined.solution.converged || !(std::sqrt(meanSquare(corrections)) <= kLargestMisfit)) {
      throw CalibrationError(kNotTogether +
                             (" (they would have to be off by " + shortNumber(std::sqrt(meanSquare(corrections))) +
                              " times the tracker's accuracy)"));
    }
  }

  std::vector<double> corrections;
  for (const auto& own : refined.solution.own) corrections.push_back(refiner.sigmas(own));
  result.misfit = std::sqrt(meanSquare(corrections));
  result.T_microscope_left = refined.T_microscope_left;
  result.T_reference_board = refined.T_reference_board;
  reportResiduals(refiner, refined, used, result);
  compareMethods(result);
  return result;
}

}  // namespace cortshift_stereo
