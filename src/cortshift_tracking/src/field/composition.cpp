#include "cortshift_tracking/field/composition.hpp"

#include <cmath>
#include <limits>
#include <optional>

namespace cortshift_tracking {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr double kOffSurface = 0.001;  // between the end of the first and the start of the second displacement [m]

struct Vector {
  Eigen::Vector3d displacement_pmr;
  double confidence;
};

Eigen::Vector3d toEigen(const cv::Vec3f& v) { return {v[0], v[1], v[2]}; }

cv::Vec3f toCv(const Eigen::Vector3d& v) {
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

/// Linear between the four grid points around a point of the surface.
std::optional<Vector> at(const DisplacementField& field, const Eigen::Vector3d& point_pmr) {
  const Eigen::Vector3d local = field.frame.T_pmr_projection.inverse() * point_pmr / field.frame.resolution;
  const double column = std::floor(local.x()), row = std::floor(local.y());
  if (!(column >= 0 && row >= 0 && column + 1 < field.frame.size.width && row + 1 < field.frame.size.height)) return {};
  const int x = static_cast<int>(column), y = static_cast<int>(row);
  const double a = local.x() - column, b = local.y() - row;
  Vector out{Eigen::Vector3d::Zero(), 0};
  Eigen::Vector3d start = Eigen::Vector3d::Zero();
  for (int i = 0; i < 4; ++i) {
    const int dx = i % 2, dy = i / 2;
    const double weight = (dx == 1 ? a : 1 - a) * (dy == 1 ? b : 1 - b);
    start += weight * toEigen(field.start_pmr.at<cv::Vec3f>(y + dy, x + dx));
    out.displacement_pmr += weight * toEigen(field.displacement_pmr.at<cv::Vec3f>(y + dy, x + dx));
    out.confidence += weight * field.confidence.at<float>(y + dy, x + dx);
  }
  const double gap = std::abs((point_pmr - start).dot(field.frame.normal_pmr()));
  if (!(gap <= kOffSurface) || !out.displacement_pmr.allFinite()) return {};
  return out;
}

}  // namespace

DisplacementField composed(const DisplacementField& first, const DisplacementField& second) {
  DisplacementField field;
  field.frame = first.frame;
  field.colour = first.colour;
  field.start_pmr = cv::Mat(first.frame.size, CV_32FC3, cv::Scalar::all(kNaN));
  field.displacement_pmr = field.start_pmr.clone();
  field.confidence = cv::Mat::zeros(first.frame.size, CV_32FC1);
  for (int row = 0; row < first.frame.size.height; ++row)
    for (int column = 0; column < first.frame.size.width; ++column) {
      const cv::Vec3f &start = first.start_pmr.at<cv::Vec3f>(row, column),
                      &step = first.displacement_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(start[0]) || std::isnan(step[0])) continue;
      const auto next = at(second, toEigen(start) + toEigen(step));
      if (!next) continue;
      field.start_pmr.at<cv::Vec3f>(row, column) = start;
      field.displacement_pmr.at<cv::Vec3f>(row, column) = toCv(toEigen(step) + next->displacement_pmr);
      field.confidence.at<float>(row, column) =
          first.confidence.at<float>(row, column) * static_cast<float>(next->confidence);
    }
  return field;
}

}  // namespace cortshift_tracking
