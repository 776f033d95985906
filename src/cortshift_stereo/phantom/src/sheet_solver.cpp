#include "sheet_solver.hpp"

#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace cortshift_stereo_phantom {
namespace {

constexpr double kMeshStep = 0.00015;  // of the starting mesh [m]; resolves the sulci
constexpr double kMargin = 0.010;      // the mesh reaches this much further than the field of view [m]

struct MeshVertex {
  float column, row, depth;  // pixel; depth along the camera's axis [m]
};

/// Calls visit(column, row, weight of b, weight of c) for pixel centres within a triangle.
template <typename Visit>
void rasterise(const MeshVertex& a, const MeshVertex& b, const MeshVertex& c, const cv::Size& size,
               const Visit& visit) {
  const float area = (b.column - a.column) * (c.row - a.row) - (b.row - a.row) * (c.column - a.column);
  if (area == 0) return;
  const int left = std::max(0, static_cast<int>(std::ceil(std::min({a.column, b.column, c.column}))));
  const int right = std::min(size.width - 1, static_cast<int>(std::floor(std::max({a.column, b.column, c.column}))));
  const int top = std::max(0, static_cast<int>(std::ceil(std::min({a.row, b.row, c.row}))));
  const int bottom = std::min(size.height - 1, static_cast<int>(std::floor(std::max({a.row, b.row, c.row}))));
  constexpr float kSlack = -1e-3F;  // no gap between neighbours
  for (int row = top; row <= bottom; ++row)
    for (int column = left; column <= right; ++column) {
      const float x = static_cast<float>(column), y = static_cast<float>(row);
      const float wb = ((x - a.column) * (c.row - a.row) - (y - a.row) * (c.column - a.column)) / area;
      const float wc = ((b.column - a.column) * (y - a.row) - (b.row - a.row) * (x - a.column)) / area;
      if (wb >= kSlack && wc >= kSlack && wb + wc <= 1 - kSlack) visit(column, row, wb, wc);
    }
}

}  // namespace

SheetSolver::SheetSolver(const PhantomScene& scene, int stage, const View& view)
    : scene_(scene), stage_(stage), view_(view) {
  T_brain_camera_ = scene.description().T_pmr_brain.inverse() * view.T_pmr_camera;
  T_camera_brain_ = T_brain_camera_.inverse();
  buildStarts();
}

SurfaceSample SheetSolver::sample(const Eigen::Vector2d& material) const {
  SurfaceSample s = scene_.sample(stage_, material.x(), material.y());
  s.point = T_camera_brain_ * s.point;
  s.along_x = T_camera_brain_.linear() * s.along_x;
  s.along_y = T_camera_brain_.linear() * s.along_y;
  return s;
}

void SheetSolver::buildStarts() {
  // Part of the material plane that the image can show: corners of the image on planes above and below the surface.
  Eigen::AlignedBox2d extent;
  for (const double u : {0.0, 0.5 * view_.size.width, view_.size.width - 1.0})
    for (const double v : {0.0, 0.5 * view_.size.height, view_.size.height - 1.0}) {
      const Eigen::Vector3d ray = T_brain_camera_.linear() * view_.direction(u, v).homogeneous();
      if (ray.z() > -0.2 * ray.norm()) continue;  // looks over the horizon
      const Eigen::Vector3d eye = T_brain_camera_.translation();
      for (const double z : {0.006, -0.030}) extent.extend((eye + (z - eye.z()) / ray.z() * ray).head<2>());
    }
  starts_ = cv::Mat_<cv::Vec2f>(view_.size, cv::Vec2f::all(std::numeric_limits<float>::quiet_NaN()));
  folded_ = cv::Mat_<uchar>(view_.size, uchar{0});
  if (extent.isEmpty()) return;
  constexpr double kFurthest = 0.2;  // [m]
  const Eigen::Vector2d low = (extent.min().array() - kMargin).max(-kFurthest);
  const Eigen::Vector2d high = (extent.max().array() + kMargin).min(kFurthest);
  const int columns = static_cast<int>((high.x() - low.x()) / kMeshStep) + 2;
  const int rows = static_cast<int>((high.y() - low.y()) / kMeshStep) + 2;
  const auto materialOf = [&](int i, int j) -> Eigen::Vector2d { return low + kMeshStep * Eigen::Vector2d(i, j); };

  std::vector<MeshVertex> vertices(static_cast<std::size_t>(columns) * rows);
  cv::parallel_for_(cv::Range(0, rows), [&](const cv::Range& range) {
    for (int j = range.start; j < range.end; ++j)
      for (int i = 0; i < columns; ++i) {
        const Eigen::Vector2d m = materialOf(i, j);
        const Eigen::Vector3d p = scene_.description().T_pmr_brain * scene_.sample(stage_, m.x(), m.y()).point;
        const double depth = (view_.T_pmr_camera.inverse() * p).z();
        const auto pixel = view_.project(p);
        MeshVertex& vertex = vertices[static_cast<std::size_t>(j) * columns + i];
        vertex = pixel ? MeshVertex{static_cast<float>(pixel->x()), static_cast<float>(pixel->y()),
                                    static_cast<float>(depth)}
                       : MeshVertex{-1, -1, 0};
      }
  });

  cv::Mat_<float> depths(view_.size, std::numeric_limits<float>::infinity());
  const auto triangle = [&](int i0, int j0, int i1, int j1, int i2, int j2) {
    const auto vertexAt = [&](int i, int j) { return vertices[static_cast<std::size_t>(j) * columns + i]; };
    const MeshVertex a = vertexAt(i0, j0), b = vertexAt(i1, j1), c = vertexAt(i2, j2);
    if (a.depth <= 0 || b.depth <= 0 || c.depth <= 0) return;
    // Counter-clockwise in material coordinates is clockwise in the image (y down) when seen from outside.
    if ((b.column - a.column) * (c.row - a.row) - (b.row - a.row) * (c.column - a.column) >= 0) {
      const cv::Rect image(cv::Point(0, 0), view_.size);
      const cv::Point corner(static_cast<int>(std::floor(std::min({a.column, b.column, c.column}))),
                             static_cast<int>(std::floor(std::min({a.row, b.row, c.row}))));
      const cv::Point other(static_cast<int>(std::ceil(std::max({a.column, b.column, c.column}))),
                            static_cast<int>(std::ceil(std::max({a.row, b.row, c.row}))));
      const cv::Rect touched = cv::Rect(corner, other + cv::Point(1, 1)) & image;
      if (!touched.empty()) folded_(touched).setTo(255);
      return;
    }
    rasterise(a, b, c, view_.size, [&](int column, int row, float wb, float wc) {
      const float depth = a.depth + wb * (b.depth - a.depth) + wc * (c.depth - a.depth);
      float& nearest = depths(row, column);
      if (depth >= nearest) return;
      nearest = depth;
      const Eigen::Vector2d m = materialOf(i0, j0) + wb * (materialOf(i1, j1) - materialOf(i0, j0)) +
                                wc * (materialOf(i2, j2) - materialOf(i0, j0));
      starts_(row, column) = cv::Vec2f(static_cast<float>(m.x()), static_cast<float>(m.y()));
    });
  };
  for (int j = 0; j + 1 < rows; ++j)
    for (int i = 0; i + 1 < columns; ++i) {
      triangle(i, j, i + 1, j, i, j + 1);
      triangle(i + 1, j, i + 1, j + 1, i, j + 1);
    }
  constexpr int kReach = 2;  // pixels around a fold that may see either sheet
  cv::dilate(folded_, folded_, cv::Mat::ones(2 * kReach + 1, 2 * kReach + 1, CV_8U));
}

std::optional<SheetHit> SheetSolver::solve(const Eigen::Vector2d& direction, const Eigen::Vector2d& start) const {
  SheetHit hit;
  hit.material = start;
  for (int i = 0; i < 30; ++i) {
    hit.surface = sample(hit.material);
    const SurfaceSample& s = hit.surface;
    if (s.point.z() <= 0) return std::nullopt;
    const Eigen::Vector2d image = s.point.hnormalized();
    Eigen::Matrix2d J;
    J << s.along_x.head<2>() - image * s.along_x.z(), s.along_y.head<2>() - image * s.along_y.z();
    J /= s.point.z();
    hit.image_to_material = J.inverse();
    Eigen::Vector2d step = hit.image_to_material * (direction - image);
    const double length = step.norm();
    constexpr double kLongest = 0.0003, kSettled = 1e-12;  // [m]
    if (!std::isfinite(length)) return std::nullopt;
    if (length > kLongest) step *= kLongest / length;
    if (length < kSettled) {
      const bool faces_camera = s.along_x.cross(s.along_y).dot(s.point) < 0;
      if (!faces_camera) return std::nullopt;
      return hit;
    }
    hit.material += step;
  }
  return std::nullopt;
}

std::optional<SheetHit> SheetSolver::nearest(const Eigen::Vector2d& direction, int column, int row) const {
  if (!isFolded(column, row)) {
    const cv::Vec2f& start = starts_(row, column);
    if (std::isfinite(start[0]))
      if (auto hit = solve(direction, {start[0], start[1]})) return hit;
  }
  // Every sheet that shows up around the pixel is tried; the nearest hit wins.
  constexpr int kReach = 2;
  constexpr double kSameSheet = 0.00025;  // starts nearer than this lead to the same hit [m]
  std::array<Eigen::Vector2d, (2 * kReach + 1) * (2 * kReach + 1)> tried;
  std::size_t count = 0;
  std::optional<SheetHit> best;
  for (int v = std::max(0, row - kReach); v <= std::min(view_.size.height - 1, row + kReach); ++v)
    for (int u = std::max(0, column - kReach); u <= std::min(view_.size.width - 1, column + kReach); ++u) {
      if (!std::isfinite(starts_(v, u)[0])) continue;
      const Eigen::Vector2d start(starts_(v, u)[0], starts_(v, u)[1]);
      bool known = false;
      for (std::size_t i = 0; i < count && !known; ++i) known = (tried[i] - start).norm() < kSameSheet;
      if (known) continue;
      tried[count++] = start;
      const auto hit = solve(direction, start);
      if (hit && (!best || hit->surface.point.z() < best->surface.point.z())) best = hit;
    }
  return best;
}

}  // namespace cortshift_stereo_phantom
