#include "cortshift_tracking/surround/surround.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "cortshift_flow/range.hpp"
#include "cortshift_flow/text.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/surround/rigid_fit.hpp"
#include "cortshift_tracking/surround/tissue.hpp"
#include "cortshift_tracking/trust/probability.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_flow::formatted;

// A fifth of that changes nothing in what a vector may be used for: a smaller disagreement is none.
constexpr double kNegligible = kRightWithin / 5;
constexpr double kLeastArea = 0.0001;     // [m^2] 25 pieces; less is a chip, a screw, a clip
constexpr double kSignificant = 22.46;    // chi-squared of 6 degrees of freedom at 0.1 %
constexpr double kWorkingDistance = 0.3;  // [m] of a surgical microscope, where its pose is not known
// Standard deviations of tracking; more is no tracking error. A drift of 1.5 mm and 0.4 degrees is up to 11 of them,
// since a turn about the field means that the camera, 0.3 m away, was moved by 2 mm the other way.
constexpr double kFarthest = 12;

double squareCentimetres(double area) { return 1e4 * area; }

/// The cameras as known; where they are not, above the field at the working distance with what is configured.
PlacedCamera placed(const std::optional<PlacedCamera>& camera, const DisplacementField& field,
                    const Eigen::Vector3d& centre, const SurroundSettings& settings) {
  PlacedCamera out;
  if (camera) {
    out = *camera;
  } else {
    out.T_pmr_camera = field.frame.T_pmr_projection;
    out.T_pmr_camera.translation() = centre + kWorkingDistance * field.frame.normal_pmr();
  }
  if (std::none_of(out.errors.begin(), out.errors.end(), [](const PoseErrorSource& e) { return e.source == kTracker; }))
    out.errors.push_back(trackerBeside(out.errors, settings.pose_translation_sd, settings.pose_rotation_sd));
  out.errors.insert(out.errors.end(), settings.calibration.begin(), settings.calibration.end());
  out.depths.insert(out.depths.end(), settings.depths.begin(), settings.depths.end());
  return out;
}

/// What should not move, and whether it can be that.
struct Resting {
  std::vector<Piece> pieces;
  bool flesh_in_view = true;
  bool may_be_brain = false;  ///< nothing says that what lies outside the outline is no brain
};

/// Pale pieces around the flesh, or, where the brain's outline is known, all outside it but cloth: what lies on the
/// brain moves with it. An outline that was drawn is believed. One that was proposed may be the edge of a hole in the
/// brain: flesh around it is no bone, and where the brain has no colour of its own it must be larger than what is
/// around it.
/// @param opening of the brain and what lies on it
Resting restingPieces(const Pieces& pieces, const cv::Mat& brain, const cv::Mat& opening, bool drawn) {
  const cv::Mat tissue = tissueOf(pieces), flesh = tissue == static_cast<uchar>(Tissue::kFlesh);
  Resting out;
  cv::Mat resting;
  if (brain.empty()) {
    resting = paleAround(tissue);
    out.flesh_in_view = cv::countNonZero(flesh) > 0;
  } else {
    const auto shareOf = [&](const cv::Mat& mask) {
      cv::Mat share;
      cv::resize(mask, share, pieces.size, 0, 0, cv::INTER_AREA);
      return share;
    };
    const cv::Mat known = tissue != static_cast<uchar>(Tissue::kNone);
    const cv::Mat share = shareOf(opening);
    cv::Mat wide;
    cv::dilate(share, wide, cv::Mat());  // an outline is right to about a piece
    resting = (wide == 0) & known & (tissue != static_cast<uchar>(Tissue::kCloth));
    const cv::Mat inside = (shareOf(brain) == 255) & known;
    const bool coloured = 2 * cv::countNonZero(flesh & inside) > cv::countNonZero(inside);
    if (!drawn && coloured) resting &= ~flesh;
    out.may_be_brain = !drawn && !coloured && cv::countNonZero((share == 255) & known) < cv::countNonZero(resting);
  }
  for (const Piece& piece : pieces.all)
    if (resting.at<uchar>(piece.cell) != 0) out.pieces.push_back(piece);
  return out;
}

std::vector<MovedPiece> moved(const std::vector<Piece>& pieces) {
  std::vector<MovedPiece> out;
  for (const Piece& piece : pieces) out.push_back({piece.place_pmr, piece.motion_pmr});
  return out;
}

std::string sizeText(const Surround& surround) {
  return formatted("%.2f mm and %.2f deg", 1e3 * surround.motion.head<3>().norm(),
                   surround.motion.tail<3>().norm() * 180 / M_PI);
}

void refuse(Surround& surround, const std::string& why) {
  surround.finding = SurroundFinding::kUnclear;
  surround.text = "no correction: " + why;
}

/// A second part of what should not move that moved as one, but otherwise than the rest.
std::optional<RigidFit> otherPart(const std::vector<MovedPiece>& pieces, const RigidFit& first,
                                  const Matrix6& tracking) {
  std::vector<MovedPiece> rest;
  for (std::size_t i = 0; i < pieces.size(); ++i)
    if (residualOf(pieces[i], first.transform) >= kRightWithin) rest.push_back(pieces[i]);
  return fitRigid(rest, tracking);
}

}  // namespace

bool SettingsError::counts(double at_magnification, double at_focal_length) const {
  constexpr double kSame = 0.005;  // relative, as the reconstruction's settings_tolerance
  return std::abs(at_magnification / magnification - 1) > kSame || std::abs(at_focal_length / focal_length - 1) > kSame;
}

void SurroundSettings::validate() const {
  cortshift_flow::requireRange<TrackingError>("pose_translation_sd", pose_translation_sd, 0.0, 0.01);
  cortshift_flow::requireRange<TrackingError>("pose_rotation_sd", pose_rotation_sd, 0.0, 0.1);
  cortshift_flow::requireRange<TrackingError>("pose_latency_sd", pose_latency_sd, 0.0, 1.0);
}

Surround assessSurround(const DisplacementField& field, const PairKnowledge& knowledge,
                        const SurroundSettings& settings, const cv::Mat& opening) {
  settings.validate();
  Surround surround;
  const Pieces pieces = piecesOf(field);
  surround.centre = centreOf(moved(pieces.all));
  const PlacedCamera earlier = placed(knowledge.earlier, field, surround.centre, settings);
  const PlacedCamera later = placed(knowledge.later, field, surround.centre, settings);
  surround.sources = poseErrorShares(earlier, later, surround.centre);
  for (const PoseErrorShare& share : surround.sources) surround.tracking += share.covariance;
  surround.covariance = surround.tracking;
  if (settings.mode == SurroundMode::kOff) {
    surround.text = "what does not move is not looked at (surround: off)";
    return surround;
  }

  const Resting chosen =
      restingPieces(pieces, field.brain, opening.empty() ? field.brain : opening, !knowledge.brain.empty());
  const std::vector<MovedPiece> resting = moved(chosen.pieces);
  const double piece_area = pieces.side * pieces.side;
  surround.area = static_cast<double>(resting.size()) * piece_area;
  if (surround.area < kLeastArea || !chosen.flesh_in_view) {
    surround.finding = SurroundFinding::kUnseen;
    surround.text =
        formatted("no correction: %.1f cm2 of bone around the brain in view, at least %.0f are needed",
                  squareCentimetres(chosen.flesh_in_view ? surround.area : 0), squareCentimetres(kLeastArea));
    return surround;
  }
  if (chosen.may_be_brain) {
    refuse(surround,
           "colour does not tell bone from brain here, and the proposed outline is smaller than what is around "
           "it, as the edge of a hole is; draw the brain's outline");
    surround.warnings.push_back("surround: " + surround.text);
    return surround;
  }

  // Exact tracking has no covariance; a nanometre keeps it invertible.
  const Matrix6 prior =
      aboutCentre(surround.tracking, surround.centre, centreOf(resting)) + 1e-18 * Matrix6::Identity();
  const auto fit = fitRigid(resting, prior);
  const double found = fit ? static_cast<double>(fit->count) * piece_area : 0;
  if (!fit || found < kLeastArea || 2 * fit->count < resting.size()) {
    refuse(surround, formatted("of %.1f cm2 that should not move only %.1f moved as one",
                               squareCentimetres(surround.area), squareCentimetres(found)));
    surround.warnings.push_back("surround: " + surround.text +
                                "; look at what lies around the brain, or draw its outline");
    return surround;
  }
  surround.area = found;
  surround.motion = aboutCentre(fit->motion, fit->centre, surround.centre);
  const Matrix6 left = aboutCentre(fit->covariance, fit->centre, surround.centre);
  surround.transform = fit->transform;

  double squares = 0, worst = 0;
  for (const Piece& piece : pieces.all) {
    squares += motionAt(surround.motion, surround.centre, piece.place_pmr).squaredNorm();
    worst += std::pow(sdAt(left, surround.centre, piece.place_pmr), 2);
  }
  const auto count = static_cast<double>(pieces.all.size());
  surround.size = std::sqrt(squares / count);
  const double left_sd = std::sqrt(worst / count);
  const double significance = surround.motion.dot(left.ldlt().solve(surround.motion));
  const double farness =
      surround.motion.dot((surround.tracking + 1e-18 * Matrix6::Identity()).ldlt().solve(surround.motion));
  const std::string on = formatted(" on %.1f cm2", squareCentimetres(surround.area));

  const auto other = otherPart(resting, *fit, prior);
  if (other && static_cast<double>(other->count) * piece_area >= kLeastArea && 3 * other->count >= fit->count) {
    const Vector6 gap = aboutCentre(other->motion, other->centre, fit->centre) - fit->motion;
    refuse(surround,
           formatted("what should not move contradicts itself: %.1f and %.1f cm2 of it moved differently, by %.2f mm",
                     squareCentimetres(surround.area),
                     squareCentimetres(static_cast<double>(other->count) * piece_area), 1e3 * gap.head<3>().norm()));
    surround.warnings.push_back("surround: " + surround.text);
    return surround;
  }
  if (left_sd > kRightWithin / 2) {
    refuse(surround,
           "what is seen" + on + formatted(" lies too much on one side: it would leave %.2f mm", 1e3 * left_sd));
    if (surround.size > 3 * left_sd) surround.warnings.push_back("surround: " + surround.text);
    return surround;
  }
  surround.finding = SurroundFinding::kAgrees;
  if (surround.size <= kNegligible || significance <= kSignificant) {
    surround.covariance = left + surround.motion * surround.motion.transpose();
    surround.text = formatted("what does not move agrees with tracking to %.2f mm", 1e3 * surround.size) + on;
    return surround;
  }
  if (farness > kFarthest * kFarthest) {
    refuse(surround, "what should not move moved by " + sizeText(surround) + on +
                         ", more than tracking is off by: it may be brain, or loose");
    surround.warnings.push_back("surround: " + surround.text + "; check the clamp and the reference frame");
    return surround;
  }
  surround.finding = SurroundFinding::kDisagrees;
  if (settings.mode == SurroundMode::kCheck) {
    surround.text = "what should not move moved by " + sizeText(surround) + on + "; not corrected (surround: check)";
    surround.warnings.push_back("tracking: " + surround.text);
    return surround;
  }
  surround.corrected = true;
  surround.covariance = left;
  surround.text = "corrected by " + sizeText(surround) + ", which what does not move seemed to move" + on;
  return surround;
}

void takeOut(const Eigen::Isometry3d& transform, const cv::Mat& starts_pmr, cv::Mat& displacements_pmr) {
  const Eigen::Isometry3d back = transform.inverse();
  for (int row = 0; row < displacements_pmr.rows; ++row)
    for (int column = 0; column < displacements_pmr.cols; ++column) {
      cv::Vec3f& d = displacements_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(d[0])) continue;
      const cv::Vec3f& x = starts_pmr.at<cv::Vec3f>(row, column);
      const Eigen::Vector3d start(x[0], x[1], x[2]);
      const Eigen::Vector3d moved = back * Eigen::Vector3d(start + Eigen::Vector3d(d[0], d[1], d[2])) - start;
      d = {static_cast<float>(moved.x()), static_cast<float>(moved.y()), static_cast<float>(moved.z())};
    }
}

}  // namespace cortshift_tracking
