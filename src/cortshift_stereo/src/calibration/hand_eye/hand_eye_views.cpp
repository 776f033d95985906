#include "calibration/hand_eye/hand_eye_views.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "calibration/outliers.hpp"
#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/geometry/lens.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::shortNumber;

constexpr double kOutlierFloorPx = 1.0;  // fit of a board to its corners; no view below is called an outlier
constexpr double kGrossFloor = 1e-3;     // [m] where a view puts the board
constexpr double kGrossTimes = 5;        // tracker noise alone brings good views to three times the median

LocatedView locate(const CameraModel& left, const std::vector<cv::Point3d>& board, const HandEyeView& view) {
  if (view.corners.size() != board.size())
    throw CalibrationError("view " + view.name + " has " + std::to_string(view.corners.size()) +
                           " corners, the board has " + std::to_string(board.size()) + "; find them again");
  const auto T_left_board = locateBoard(left, board, view.corners);
  if (!T_left_board)
    throw CalibrationError("view " + view.name + ": no pose of the board fits its corners; take the view out");
  const Corners projected = projectPoints(left, board, T_left_board->rvec(), T_left_board->translation());
  double squares = 0;
  for (std::size_t i = 0; i < board.size(); ++i) {
    const cv::Point2d miss = projected[i] - view.corners[i];
    squares += miss.dot(miss);
  }
  return {view, *T_left_board, std::sqrt(squares / static_cast<double>(board.size()))};
}

void requireEnough(const std::vector<LocatedView>& views, const std::vector<RejectedView>& rejected) {
  if (views.size() >= kFewestHandEyeViews) return;
  std::string message = "only " + std::to_string(views.size()) + " usable views; at least " +
                        std::to_string(kFewestHandEyeViews) +
                        " with the microscope turned about different axes are needed: take more";
  for (const auto& view : rejected) message += "\n  " + view.name + ": " + view.reason;
  throw CalibrationError(message);
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
         "its tracked pose puts the board " + shortNumber(suspect_distance * 1e3) +
             " mm from where the other views have it (" + shortNumber(typical_distance * 1e3) +
             " mm is typical); did the tracker lose the microscope, or the board move?",
         rejected);
  return true;
}

}  // namespace

const std::string kNotTogether =
    "the tracked poses and the images do not belong together. Are they poses of the microscope in the reference frame "
    "(not the inverse), in metres, each with its own image, is the side of a square right, and did the board stay "
    "where it was?";

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

BoardInReference::BoardInReference(const std::vector<cv::Point3d>& board, const cv::Affine3d& T_microscope_left,
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

double BoardInReference::distance(const LocatedView& located) const {
  const auto points = place(located);
  double squares = 0;
  for (std::size_t i = 0; i < points.size(); ++i) squares += (points[i] - typical_[i]).dot(points[i] - typical_[i]);
  return std::sqrt(squares / static_cast<double>(points.size()));
}

std::vector<double> BoardInReference::distances(const std::vector<LocatedView>& views) const {
  std::vector<double> all;
  for (const auto& located : views) all.push_back(distance(located));
  return all;
}

std::vector<cv::Point3d> BoardInReference::place(const LocatedView& located) const {
  const cv::Affine3d T_reference_board =
      located.view.T_reference_microscope * T_microscope_left_ * located.T_left_board;
  std::vector<cv::Point3d> points;
  for (const auto& corner : board_) points.push_back(T_reference_board * corner);
  return points;
}

double meanSquare(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value * value;
  return sum / static_cast<double>(values.size());
}

void reject(std::vector<LocatedView>& views, std::size_t at, const std::string& reason,
            std::vector<RejectedView>& rejected) {
  rejected.push_back({views[at].view.name, reason});
  views.erase(views.begin() + static_cast<std::ptrdiff_t>(at));
  requireEnough(views, rejected);
}

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
           "the board fits its corners only to " + shortNumber(fits[*worst]) + " px; blurred or partly hidden?",
           rejected);
    fits.erase(fits.begin() + static_cast<std::ptrdiff_t>(*worst));
  }
  while (rejectWorstPose(board, used, rejected)) continue;
  return used;
}

}  // namespace cortshift_stereo
