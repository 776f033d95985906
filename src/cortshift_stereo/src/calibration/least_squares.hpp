// Levenberg-Marquardt for problems made of views: a few parameters that all views share and a few of each view's own.
// Eigen's unsupported one does not know which residuals a parameter moves: its central differences for 20 views of a
// hand-eye calibration (132 parameters) ask for 5280 views a step, these for 720. Ceres knows, for 26 Debian packages
// more.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

namespace cortshift_stereo {

/// Residuals of one view, given the shared parameters and the view's own. Their number may differ from view to view;
/// either kind of parameters may be empty.
using ViewResiduals =
    std::function<Eigen::VectorXd(std::size_t view, const Eigen::VectorXd& shared, const Eigen::VectorXd& own)>;

struct LeastSquaresSolution {
  Eigen::VectorXd shared;
  std::vector<Eigen::VectorXd> own;
  double cost = 0;             ///< sum of squared residuals
  Eigen::MatrixXd covariance;  ///< of the shared parameters, for residuals of unit variance, the others estimated too
  bool converged = false;
};

/// Minimise the sum of squared residuals of all views from the given start. Derivatives are taken numerically, so
/// parameters should be of order 0.001 to 1 (metres, radians).
LeastSquaresSolution minimise(const ViewResiduals& residuals, const Eigen::VectorXd& shared,
                              const std::vector<Eigen::VectorXd>& own);

}  // namespace cortshift_stereo
