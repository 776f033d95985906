#include "cortshift_tracking/igtl/space.hpp"

#include <Eigen/SVD>
#include <sstream>

namespace cortshift_tracking::igt {
namespace {

constexpr double kMmPerMetre = 1000.0;
constexpr double kRotationTolerance = 1e-4;

}  // namespace

Axes axesFromText(const std::string& text) {
  if (text == "ras") return Axes::kRas;
  if (text == "lps") return Axes::kLps;
  throw std::invalid_argument("axes '" + text + "' are not known; allowed is ras, lps");
}

LinkSpace::LinkSpace(Axes pmr_axes, Axes link_axes)
    : link_axes_(link_axes),
      pmr_signs_(pmr_axes == link_axes ? Eigen::Vector3d(1, 1, 1) : Eigen::Vector3d(-1, -1, 1)) {}

Eigen::Vector3d LinkSpace::signsOf(const std::string& frame) const {
  return frame == "pmr" ? pmr_signs_ : Eigen::Vector3d(1, 1, 1);
}

Eigen::Isometry3d LinkSpace::poseFromLink(const Eigen::Matrix4d& matrix_mm, const std::string& parent,
                                          const std::string& child) const {
  if (!matrix_mm.allFinite()) throw PoseError("the matrix holds numbers that are not finite");
  if ((matrix_mm.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 0)
    throw PoseError("the last row of the matrix is not 0 0 0 1");
  const Eigen::Matrix3d given = matrix_mm.topLeftCorner<3, 3>();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(given, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d rotation = svd.matrixU() * svd.matrixV().transpose();
  const double deviation = (rotation - given).cwiseAbs().maxCoeff();
  if (rotation.determinant() < 0 || deviation > kRotationTolerance) {
    std::ostringstream text;
    text << "the matrix is not a rigid transform (determinant " << given.determinant() << ", " << deviation
         << " from the nearest rotation; allowed is " << kRotationTolerance << ")";
    throw PoseError(text.str());
  }
  const Eigen::Vector3d parent_signs = signsOf(parent), child_signs = signsOf(child);
  Eigen::Isometry3d T_parent_child = Eigen::Isometry3d::Identity();
  T_parent_child.linear() = parent_signs.asDiagonal() * rotation * child_signs.asDiagonal();
  T_parent_child.translation() = parent_signs.cwiseProduct(matrix_mm.topRightCorner<3, 1>()) / kMmPerMetre;
  return T_parent_child;
}

Eigen::Matrix4d LinkSpace::poseToLink(const Eigen::Isometry3d& T_parent_child, const std::string& parent,
                                      const std::string& child) const {
  const Eigen::Vector3d parent_signs = signsOf(parent), child_signs = signsOf(child);
  Eigen::Matrix4d matrix_mm = Eigen::Matrix4d::Identity();
  matrix_mm.topLeftCorner<3, 3>() = parent_signs.asDiagonal() * T_parent_child.linear() * child_signs.asDiagonal();
  matrix_mm.topRightCorner<3, 1>() = parent_signs.cwiseProduct(T_parent_child.translation()) * kMmPerMetre;
  return matrix_mm;
}

Eigen::Vector3d LinkSpace::vectorToLink(const Eigen::Vector3d& vector_pmr) const {
  return pmr_signs_.cwiseProduct(vector_pmr) * kMmPerMetre;
}

Eigen::Vector3d LinkSpace::vectorFromLink(const Eigen::Vector3d& vector_mm) const {
  return pmr_signs_.cwiseProduct(vector_mm) / kMmPerMetre;
}

}  // namespace cortshift_tracking::igt
