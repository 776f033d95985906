#include "calibration/least_squares.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

namespace cortshift_stereo {
namespace {

constexpr double kStep = 1e-6;
constexpr int kMostIterations = 100;
constexpr double kSmallestGain = 1e-12;  // relative decrease of the cost at which the iteration stops
constexpr double kSmallestStep = 1e-12;
constexpr double kLargestDamping = 1e12;

struct NormalEquations {
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  double cost = 0;
};

double costOf(const ViewResiduals& residuals, const Eigen::VectorXd& shared, const std::vector<Eigen::VectorXd>& own) {
  double cost = 0;
  for (std::size_t view = 0; view < own.size(); ++view) cost += residuals(view, shared, own[view]).squaredNorm();
  return cost;
}

NormalEquations linearise(const ViewResiduals& residuals, const Eigen::VectorXd& shared,
                          const std::vector<Eigen::VectorXd>& own) {
  Eigen::Index size = shared.size();
  for (const auto& parameters : own) size += parameters.size();
  NormalEquations normal{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size), 0};
  Eigen::Index at = shared.size();
  for (std::size_t view = 0; view < own.size(); ++view) {
    const Eigen::Index many = shared.size();
    const Eigen::Index few = own[view].size();
    const Eigen::VectorXd here = residuals(view, shared, own[view]);
    Eigen::MatrixXd jacobian(here.size(), many + few);
    for (Eigen::Index i = 0; i < many + few; ++i) {
      Eigen::VectorXd shared_up = shared, own_up = own[view], shared_down = shared, own_down = own[view];
      (i < many ? shared_up(i) : own_up(i - many)) += kStep;
      (i < many ? shared_down(i) : own_down(i - many)) -= kStep;
      jacobian.col(i) = (residuals(view, shared_up, own_up) - residuals(view, shared_down, own_down)) / (2 * kStep);
    }
    const Eigen::MatrixXd product = jacobian.transpose() * jacobian;
    const Eigen::VectorXd slope = jacobian.transpose() * here;
    normal.hessian.topLeftCorner(many, many) += product.topLeftCorner(many, many);
    normal.hessian.block(0, at, many, few) = product.topRightCorner(many, few);
    normal.hessian.block(at, 0, few, many) = product.bottomLeftCorner(few, many);
    normal.hessian.block(at, at, few, few) = product.bottomRightCorner(few, few);
    normal.gradient.head(many) += slope.head(many);
    normal.gradient.segment(at, few) = slope.tail(few);
    normal.cost += here.squaredNorm();
    at += few;
  }
  return normal;
}

void advance(const Eigen::VectorXd& step, Eigen::VectorXd& shared, std::vector<Eigen::VectorXd>& own) {
  shared += step.head(shared.size());
  Eigen::Index at = shared.size();
  for (auto& parameters : own) {
    parameters += step.segment(at, parameters.size());
    at += parameters.size();
  }
}

}  // namespace

LeastSquaresSolution minimise(const ViewResiduals& residuals, const Eigen::VectorXd& shared,
                              const std::vector<Eigen::VectorXd>& own) {
  LeastSquaresSolution solution;
  solution.shared = shared;
  solution.own = own;
  double damping = 1e-4;
  NormalEquations normal = linearise(residuals, solution.shared, solution.own);
  for (int i = 0; i < kMostIterations && !solution.converged && damping < kLargestDamping; ++i) {
    Eigen::MatrixXd damped = normal.hessian;
    damped.diagonal() *= 1 + damping;
    Eigen::VectorXd next_shared = solution.shared;
    auto next_own = solution.own;
    const Eigen::VectorXd step = -damped.ldlt().solve(normal.gradient);
    advance(step, next_shared, next_own);
    const double cost = costOf(residuals, next_shared, next_own);
    solution.converged =
        std::abs(normal.cost - cost) <= kSmallestGain * normal.cost || step.lpNorm<Eigen::Infinity>() <= kSmallestStep;
    if (!(cost <= normal.cost)) {  // also where it is NaN
      damping *= 10;
      continue;
    }
    solution.shared = next_shared;
    solution.own = next_own;
    damping /= 10;
    normal = linearise(residuals, solution.shared, solution.own);
  }
  solution.cost = normal.cost;
  if (shared.size() > 0)
    solution.covariance =
        normal.hessian.fullPivLu().inverse().topLeftCorner(solution.shared.size(), solution.shared.size());
  return solution;
}

}  // namespace cortshift_stereo
