#include "cortshift_tracking/field/closure.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace cortshift_tracking {
namespace {

std::optional<Eigen::Vector3d> displacementAt(const DisplacementField& field, const Eigen::Vector3d& point_pmr) {
  const Eigen::Vector3d p = field.frame.T_pmr_projection.inverse() * point_pmr / field.frame.resolution;
  const int x = static_cast<int>(std::floor(p[0])), y = static_cast<int>(std::floor(p[1]));
  if (x < 0 || y < 0 || x + 1 >= field.frame.size.width || y + 1 >= field.frame.size.height) return {};
  const double fx = p[0] - x, fy = p[1] - y;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int j = 0; j < 2; ++j)
    for (int i = 0; i < 2; ++i) {
      const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(y + j, x + i);
      sum += (i == 0 ? 1 - fx : fx) * (j == 0 ? 1 - fy : fy) * Eigen::Vector3d(d[0], d[1], d[2]);
    }
  if (!sum.allFinite()) return {};
  return sum;
}

}  // namespace

Closure closureOf(const std::vector<DisplacementField>& consecutive, const DisplacementField& direct) {
  std::vector<double> gaps;
  for (int row = 0; row < direct.frame.size.height; ++row)
    for (int column = 0; column < direct.frame.size.width; ++column) {
      const cv::Vec3f& p = direct.start_pmr.at<cv::Vec3f>(row, column);
      const cv::Vec3f& d = direct.displacement_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(d[0])) continue;
      const Eigen::Vector3d start(p[0], p[1], p[2]);
      Eigen::Vector3d point = start;
      bool followed = true;
      for (const DisplacementField& field : consecutive) {
        const auto step = displacementAt(field, point);
        if (!(followed = step.has_value())) break;
        point += *step;
      }
      if (followed) gaps.push_back((point - start - Eigen::Vector3d(d[0], d[1], d[2])).norm());
    }
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  if (gaps.empty()) return {0, unknown, unknown};
  std::sort(gaps.begin(), gaps.end());
  return {gaps.size(), gaps[gaps.size() / 2], gaps[gaps.size() * 95 / 100]};
}

}  // namespace cortshift_tracking
