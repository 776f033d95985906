#include "cortshift_tracking/field/inversion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cortshift_flow/range.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/projection/mesh.hpp"
#include "parallel.hpp"

namespace cortshift_tracking {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// Height at (column, row) on the mesh, by Newton steps in image coordinates: the mesh is linear in each triangle, so
/// a step that stays in its triangle is exact. `source` is where to begin.
std::optional<double> heightOnMesh(const Projection& projection, double column, double row, cv::Vec2f source) {
  constexpr int kMostSteps = 12;
  constexpr double kRounding = 1e-5;
  const cv::Mat& vertices = projection.vertices;
  double s = source[0], t = source[1];
  for (int step = 0; step < kMostSteps; ++step) {
    const int x = std::clamp(static_cast<int>(std::floor(s)), 0, vertices.cols - 2);
    const int y = std::clamp(static_cast<int>(std::floor(t)), 0, vertices.rows - 2);
    const int half = (s - x) + (t - y) > 1 ? 1 : 0;
    const auto& corners = QuadTriangles::kCorners[half];
    const cv::Vec3f& a = vertices.at<cv::Vec3f>(y + corners[0][1], x + corners[0][0]);
    const cv::Vec3f& b = vertices.at<cv::Vec3f>(y + corners[1][1], x + corners[1][0]);
    const cv::Vec3f& c = vertices.at<cv::Vec3f>(y + corners[2][1], x + corners[2][0]);
    if (!isTriangle(a, b, c, projection.max_edge)) return {};
    const double abx = b[0] - a[0], aby = b[1] - a[1], acx = c[0] - a[0], acy = c[1] - a[1];
    const double area = abx * acy - aby * acx;
    if (area == 0) return {};
    const double px = column - a[0], py = row - a[1];
    const double wb = (px * acy - py * acx) / area, wc = (abx * py - aby * px) / area;
    if (wb >= -kRounding && wc >= -kRounding && wb + wc <= 1 + kRounding)
      return a[2] + wb * (b[2] - a[2]) + wc * (c[2] - a[2]);
    // Where the target would lie if this triangle were larger; a small extra step avoids the shared edge.
    const double wa = 1 - wb - wc;
    const double next_s = x + wa * corners[0][0] + wb * corners[1][0] + wc * corners[2][0];
    const double next_t = y + wa * corners[0][1] + wb * corners[1][1] + wc * corners[2][1];
    constexpr double kNudge = 1e-4, kLongestStep = 3;
    s += std::clamp((1 + kNudge) * (next_s - s), -kLongestStep, kLongestStep);
    t += std::clamp((1 + kNudge) * (next_t - t), -kLongestStep, kLongestStep);
  }
  return {};
}

/// Height between four covered grid points.
std::optional<double> heightOnGrid(const Projection& projection, double column, double row) {
  const int x = std::min(static_cast<int>(column), projection.mask.cols - 2),
            y = std::min(static_cast<int>(row), projection.mask.rows - 2);
  if (x < 0 || y < 0) return {};
  const double fx = column - x, fy = row - y;
  const auto at = [&](int dy, int dx) { return static_cast<double>(projection.height.at<float>(y + dy, x + dx)); };
  const double height = (1 - fy) * ((1 - fx) * at(0, 0) + fx * at(0, 1)) + fy * ((1 - fx) * at(1, 0) + fx * at(1, 1));
  if (std::isnan(height)) return {};
  return height;
}

struct Lookup {
  const Projection& projection;
  Interpolation interpolation;

  std::optional<double> height(double column, double row) const {
    const cv::Size size = projection.mask.size();
    if (!(column >= 0 && row >= 0 && column <= size.width - 1 && row <= size.height - 1)) return {};
    const int x = static_cast<int>(std::lround(column)), y = static_cast<int>(std::lround(row));
    if (interpolation == Interpolation::kNearest) {
      if (projection.mask.at<uchar>(y, x) == 0) return {};
      return projection.height.at<float>(y, x);
    }
    const int x0 = static_cast<int>(column), y0 = static_cast<int>(row);
    const int around[5][2] = {{x, y}, {x0, y0}, {x0 + 1, y0}, {x0, y0 + 1}, {x0 + 1, y0 + 1}};
    for (const auto& [i, j] : around) {
      if (i >= size.width || j >= size.height || projection.mask.at<uchar>(j, i) == 0) continue;
      if (const auto found = heightOnMesh(projection, column, row, projection.source.at<cv::Vec2f>(j, i)))
        return *found * projection.resolution;
    }
    return heightOnGrid(projection, column, row);
  }
};

Eigen::Vector3d onPlane(const ProjectionFrame& frame, double column, double row, double height) {
  return frame.T_pmr_projection * Eigen::Vector3d(column * frame.resolution, row * frame.resolution, height);
}

cv::Vec3f toCv(const Eigen::Vector3d& v) {
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

void check(const ProjectionFrame& frame, const Projection& earlier, const Projection& later, const cv::Mat& flow,
           const cv::Mat& confidence) {
  if (earlier.mask.size() != frame.size || later.mask.size() != frame.size || flow.size() != frame.size ||
      flow.type() != CV_32FC2 || confidence.size() != frame.size || confidence.type() != CV_32FC1)
    throw TrackingError("the projections, the flow and the confidence are not on the frame's grid");
}

bool passes(float confidence, const InversionSettings& settings) {
  return confidence > 0 && confidence >= static_cast<float>(settings.min_confidence);
}

}  // namespace

void InversionSettings::validate() const {
  cortshift_flow::requireRange<TrackingError>("min_confidence", min_confidence, 0.0, 1.0);
  cortshift_flow::requireRange<TrackingError>("threads", threads, 0, 256);
}

std::optional<double> heightAt(const Projection& projection, double column, double row, Interpolation interpolation) {
  return Lookup{projection, interpolation}.height(column, row);
}

DisplacementField invert(const ProjectionFrame& frame, const Projection& earlier, const Projection& later,
                         const cv::Mat& flow, const cv::Mat& confidence, const InversionSettings& settings) {
  settings.validate();
  check(frame, earlier, later, flow, confidence);
  DisplacementField field;
  field.frame = frame;
  field.start_pmr = cv::Mat(frame.size, CV_32FC3, cv::Scalar::all(kNaN));
  field.displacement_pmr = cv::Mat(frame.size, CV_32FC3, cv::Scalar::all(kNaN));
  earlier.colour.convertTo(field.colour, CV_8UC3, 255);
  field.confidence = confidence.clone();
  const Lookup lookup{later, settings.interpolation};
  parallelRanges(frame.size.height, settings.threads, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int column = 0; column < frame.size.width; ++column) {
        if (earlier.mask.at<uchar>(row, column) == 0 || !passes(confidence.at<float>(row, column), settings)) continue;
        const cv::Vec2f u = flow.at<cv::Vec2f>(row, column);
        const auto end_height = lookup.height(column + u[0], row + u[1]);
        if (!end_height) continue;
        const double height = earlier.height.at<float>(row, column);
        field.start_pmr.at<cv::Vec3f>(row, column) = toCv(onPlane(frame, column, row, height));
        field.displacement_pmr.at<cv::Vec3f>(row, column) =
            toCv(frame.T_pmr_projection.linear() *
                 Eigen::Vector3d(u[0] * frame.resolution, u[1] * frame.resolution, *end_height - height));
      }
  });
  return field;
}

cv::Mat displacementsOfPoints(const ProjectionFrame& frame, const Projection& earlier, const Projection& later,
                              const cv::Mat& flow, const cv::Mat& confidence, const InversionSettings& settings) {
  settings.validate();
  check(frame, earlier, later, flow, confidence);
  cv::Mat displacements(earlier.vertices.size(), CV_32FC3, cv::Scalar::all(kNaN));
  const Lookup lookup{later, settings.interpolation};
  parallelRanges(displacements.rows, settings.threads, [&](int first, int last) {
    for (int i = first; i < last; ++i)
      for (int j = 0; j < displacements.cols; ++j) {
        const cv::Vec3f vertex = earlier.vertices.at<cv::Vec3f>(i, j);
        if (!isPoint(vertex)) continue;
        const int x = static_cast<int>(std::floor(vertex[0])), y = static_cast<int>(std::floor(vertex[1]));
        if (x < 0 || y < 0 || x + 1 >= frame.size.width || y + 1 >= frame.size.height) continue;
        const auto trusted = [&](int dy, int dx) { return passes(confidence.at<float>(y + dy, x + dx), settings); };
        if (!trusted(0, 0) || !trusted(0, 1) || !trusted(1, 0) || !trusted(1, 1)) continue;
        const float fx = vertex[0] - static_cast<float>(x), fy = vertex[1] - static_cast<float>(y);
        const cv::Vec2f u = (1 - fy) * ((1 - fx) * flow.at<cv::Vec2f>(y, x) + fx * flow.at<cv::Vec2f>(y, x + 1)) +
                            fy * ((1 - fx) * flow.at<cv::Vec2f>(y + 1, x) + fx * flow.at<cv::Vec2f>(y + 1, x + 1));
        const auto end_height = lookup.height(vertex[0] + u[0], vertex[1] + u[1]);
        if (!end_height) continue;
        displacements.at<cv::Vec3f>(i, j) =
            toCv(frame.T_pmr_projection.linear() * Eigen::Vector3d(u[0] * frame.resolution, u[1] * frame.resolution,
                                                                   *end_height - vertex[2] * frame.resolution));
      }
  });
  return displacements;
}

}  // namespace cortshift_tracking
