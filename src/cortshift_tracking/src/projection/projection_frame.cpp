#include "cortshift_tracking/projection/projection_frame.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "cortshift_flow/range.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/projection/mesh.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kFacetEdgeRatio = 3;     // facets stretched beyond this lie across a depth step
constexpr double kFacetConeCosine = 0.5;  // 60 degrees
constexpr std::size_t kFewestFacets = 16;
constexpr double kMostGridPoints = 36e6;

Eigen::Vector3d toEigen(const cv::Vec3f& p) { return {p[0], p[1], p[2]}; }

double medianOf(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Facets {
  std::vector<Eigen::Vector3d> areas;  // normal towards the camera, length: area [m^2]
  Eigen::Vector3d along_columns = Eigen::Vector3d::Zero();
};

/// Facets that are a few pixels wide: their normals are much less noisy than those of single pixels.
Facets facetsOf(const cv::Mat& points) {
  const int step = std::clamp(std::min(points.cols, points.rows) / 64, 1, 8);
  const double longest = kFacetEdgeRatio * step * medianSpacing(points);
  Facets facets;
  for (int row = 0; row + step < points.rows; row += step)
    for (int column = 0; column + step < points.cols; column += step) {
      const Eigen::Vector3d a = toEigen(points.at<cv::Vec3f>(row, column)),
                            b = toEigen(points.at<cv::Vec3f>(row, column + step)),
                            c = toEigen(points.at<cv::Vec3f>(row + step, column)),
                            d = toEigen(points.at<cv::Vec3f>(row + step, column + step));
      const bool connected = (b - a).norm() <= longest && (c - a).norm() <= longest && (d - b).norm() <= longest &&
                             (d - c).norm() <= longest;  // false with any NaN
      if (!connected) continue;
      // Image columns run right and rows down, so rows x columns points back at the camera.
      facets.areas.push_back(0.5 * (c - b).cross(d - a));
      facets.along_columns += (b - a) + (d - c);
    }
  if (facets.areas.size() < kFewestFacets)
    throw TrackingError("the surface has too few connected points for a normal (" +
                        std::to_string(facets.areas.size()) + " facets, " + std::to_string(kFewestFacets) +
                        " are needed); capture the stage again with the cortex in view");
  return facets;
}

Eigen::Vector3d averageNormalOf(const Facets& facets) {
  std::vector<double> components[3];
  for (const Eigen::Vector3d& area : facets.areas) {
    const Eigen::Vector3d unit = area.normalized();
    for (int i = 0; i < 3; ++i) components[i].push_back(unit[i]);
  }
  Eigen::Vector3d normal(medianOf(components[0]), medianOf(components[1]), medianOf(components[2]));
  for (int round = 0; round < 3; ++round) {
    normal.normalize();
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& area : facets.areas)
      if (area.dot(normal) >= kFacetConeCosine * area.norm()) sum += area;
    if (!(sum.norm() > 0))
      throw TrackingError("the surface has no prevailing normal; capture the stage again with the cortex in view");
    normal = sum;
  }
  return normal.normalized();
}

}  // namespace

void FrameSettings::validate() const {
  cortshift_flow::requireRange<TrackingError>("resolution", resolution, 0.00005, 0.001);
  cortshift_flow::requireRange<TrackingError>("margin", margin, 0.0, 0.02);
}

Eigen::Vector3d averageNormal(const cortshift_stereo::Surface& surface_pmr) {
  return averageNormalOf(facetsOf(surface_pmr.points));
}

ProjectionFrame fitProjectionFrame(const cortshift_stereo::Surface& surface_pmr, const FrameSettings& settings) {
  settings.validate();
  const Facets facets = facetsOf(surface_pmr.points);
  const Eigen::Vector3d z = averageNormalOf(facets);
  const Eigen::Vector3d x = (facets.along_columns - facets.along_columns.dot(z) * z).normalized();
  const Eigen::Vector3d y = z.cross(x);

  const Eigen::RowVector3d row_z = z.transpose();
  std::vector<double> heights;
  const cv::Mat& points = surface_pmr.points;
  for (int row = 0; row < points.rows; ++row)
    for (int column = row % 4; column < points.cols; column += 4) {
      const cv::Vec3f& p = points.at<cv::Vec3f>(row, column);
      if (isPoint(p)) heights.push_back(row_z * toEigen(p));
    }
  const double middle = medianOf(heights);
  for (double& height : heights) height = std::abs(height - middle);
  // An outlier in depth also lies far to the side, because it moves along its ray.
  const double reach = 10 * medianOf(heights) + 0.005;

  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double low_x = kInfinity, low_y = kInfinity, high_x = -kInfinity, high_y = -kInfinity;
  for (int row = 0; row < points.rows; ++row)
    for (int column = 0; column < points.cols; ++column) {
      const cv::Vec3f& p = points.at<cv::Vec3f>(row, column);
      if (!isPoint(p)) continue;
      const Eigen::Vector3d v = toEigen(p);
      if (std::abs(z.dot(v) - middle) > reach) continue;
      low_x = std::min(low_x, x.dot(v));
      high_x = std::max(high_x, x.dot(v));
      low_y = std::min(low_y, y.dot(v));
      high_y = std::max(high_y, y.dot(v));
    }
  low_x -= settings.margin;
  low_y -= settings.margin;
  const double columns = std::floor((high_x + settings.margin - low_x) / settings.resolution) + 1;
  const double rows = std::floor((high_y + settings.margin - low_y) / settings.resolution) + 1;
  if (!(columns * rows <= kMostGridPoints))
    throw TrackingError("the projection grid would have " + std::to_string(static_cast<long long>(columns)) + " x " +
                        std::to_string(static_cast<long long>(rows)) +
                        " points; choose a coarser resolution or remove far points from the surface");

  ProjectionFrame frame;
  frame.resolution = settings.resolution;
  frame.size = cv::Size(static_cast<int>(columns), static_cast<int>(rows));
  frame.T_pmr_projection.linear() << x, y, z;
  frame.T_pmr_projection.translation() = low_x * x + low_y * y + middle * z;
  return frame;
}

}  // namespace cortshift_tracking
