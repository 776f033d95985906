#include "cortshift_tracking/surround/rigid_fit.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace cortshift_tracking {
namespace {

constexpr std::size_t kFewest = 6;

Eigen::Matrix<double, 3, 6> rowsOf(const Eigen::Vector3d& arm) {
  Eigen::Matrix<double, 3, 6> rows;
  rows << 1, 0, 0, 0, arm.z(), -arm.y(), 0, 1, 0, -arm.z(), 0, arm.x(), 0, 0, 1, arm.y(), -arm.x(), 0;
  return rows;
}

Eigen::Isometry3d transformOf(const Vector6& motion, const Eigen::Vector3d& centre) {
  const Eigen::Vector3d turn = motion.tail<3>();
  const double angle = turn.norm();
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  if (angle > 0) transform.linear() = Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
  transform.translation() = centre + motion.head<3>() - transform.linear() * centre;
  return transform;
}

/// The motion of three pieces; nothing where they nearly lie on a line.
std::optional<Vector6> motionOfThree(const std::vector<MovedPiece>& pieces, const std::size_t (&chosen)[3],
                                     const Eigen::Vector3d& centre) {
  constexpr double kShortest = 0.003;  // [m] a triangle less high than this says little about rotation
  const Eigen::Vector3d a = pieces[chosen[1]].place - pieces[chosen[0]].place,
                        b = pieces[chosen[2]].place - pieces[chosen[0]].place;
  const double longest = std::max({a.norm(), b.norm(), (a - b).norm()});
  if (!(longest > 0) || a.cross(b).norm() / longest < kShortest) return std::nullopt;
  Matrix6 normal = Matrix6::Zero();
  Vector6 right = Vector6::Zero();
  for (const std::size_t i : chosen) {
    const auto rows = rowsOf(pieces[i].place - centre);
    normal += rows.transpose() * rows;
    right += rows.transpose() * pieces[i].motion;
  }
  return normal.ldlt().solve(right);
}

/// Numbers that are the same each time (Knuth's multiplicative congruence, the upper bits).
class Sequence {
 public:
  std::size_t below(std::size_t end) {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<std::size_t>((state_ >> 33) % end);
  }

 private:
  std::uint64_t state_ = 1;
};

}  // namespace

double residualOf(const MovedPiece& piece, const Eigen::Isometry3d& transform) {
  return (piece.place + piece.motion - transform * piece.place).norm();
}

Eigen::Vector3d centreOf(const std::vector<MovedPiece>& pieces) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const MovedPiece& piece : pieces) sum += piece.place;
  return pieces.empty() ? sum : Eigen::Vector3d(sum / static_cast<double>(pieces.size()));
}

std::optional<RigidFit> fitRigid(const std::vector<MovedPiece>& pieces, const Matrix6& prior,
                                 const RigidFitSettings& settings) {
  if (pieces.size() < kFewest) return std::nullopt;
  RigidFit fit;
  fit.centre = centreOf(pieces);

  constexpr int kTriples = 400;  // with a third of the pieces sharing the motion, one in 27 triples is good
  Sequence sequence;
  std::size_t most = 0;
  for (int i = 0; i < kTriples; ++i) {
    const std::size_t chosen[3] = {sequence.below(pieces.size()), sequence.below(pieces.size()),
                                   sequence.below(pieces.size())};
    const auto motion = motionOfThree(pieces, chosen, fit.centre);
    if (!motion) continue;
    const Eigen::Isometry3d transform = transformOf(*motion, fit.centre);
    const auto agree = static_cast<std::size_t>(std::count_if(pieces.begin(), pieces.end(), [&](const MovedPiece& p) {
      return residualOf(p, transform) < settings.agreement;
    }));
    if (agree > most) {
      most = agree;
      fit.motion = *motion;
    }
  }
  if (most < kFewest) return std::nullopt;

  // Which pieces share the motion is for them alone to say; the prior, a hundred times as wide, keeps it solvable.
  const Matrix6 known = prior.ldlt().solve(Matrix6::Identity()), hardly_known = 1e-4 * known;
  Matrix6 measured = Matrix6::Zero();
  constexpr double kTukey = 4.685;      // 95 % efficient for a normal distribution
  constexpr double kLeastSd = 0.00001;  // [m] of a piece: what the phantom's fields have at best (shift_benchmark)
  for (int round = 0; round < 10; ++round) {
    const Eigen::Isometry3d transform = transformOf(fit.motion, fit.centre);
    std::vector<double> off;
    for (const MovedPiece& piece : pieces)
      if (residualOf(piece, transform) < settings.agreement) off.push_back(residualOf(piece, transform));
    if (off.size() < kFewest) return std::nullopt;
    std::nth_element(off.begin(), off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2), off.end());
    // The length of three normal coordinates has its median at 1.538 of their standard deviation.
    fit.sd = std::max(off[off.size() / 2] / 1.538, kLeastSd);
    Matrix6 normal = Matrix6::Zero();
    Vector6 right = Vector6::Zero();
    fit.shares.assign(pieces.size(), 0);
    fit.count = 0;
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      const double distance = residualOf(pieces[i], transform);
      // Three coordinates: as far out as 4.685 sd of one would be.
      const double part = distance / (kTukey * std::sqrt(3.0) * fit.sd);
      if (part >= 1 || distance >= settings.agreement) continue;
      fit.shares[i] = 1;
      ++fit.count;
      const double weight = (1 - part * part) * (1 - part * part);
      const auto rows = rowsOf(pieces[i].place - fit.centre);
      normal += weight * rows.transpose() * rows;
      right += weight * rows.transpose() * (pieces[i].place + pieces[i].motion - transform * pieces[i].place);
    }
    if (fit.count < kFewest) return std::nullopt;
    const double scale = 1 / (settings.hold * fit.sd * fit.sd);
    measured = scale * normal;
    const Vector6 step =
        Matrix6(measured + hardly_known).ldlt().solve(Vector6(scale * right - hardly_known * fit.motion));
    fit.motion += step;
    if (step.head<3>().norm() < 1e-8 && step.tail<3>().norm() < 1e-7) break;
  }
  const Eigen::LDLT<Matrix6> together = Matrix6(measured + known).ldlt();
  fit.motion = together.solve(Vector6((measured + hardly_known) * fit.motion));
  fit.covariance = together.solve(Matrix6::Identity());
  fit.transform = transformOf(fit.motion, fit.centre);
  return fit;
}

}  // namespace cortshift_tracking
