// Intersects the rays of a view with the deformed surface: Newton in material coordinates, started from a depth buffer
// of a coarse mesh so that it converges to the nearest of several intersections.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace cortshift_stereo_phantom {

/// One ray's hit, in the camera frame.
struct SheetHit {
  Eigen::Vector2d material;           ///< [m]
  SurfaceSample surface;              ///< in the camera frame
  Eigen::Matrix2d image_to_material;  ///< derivative of material coordinates with respect to (x/z, y/z)
};

class SheetSolver {
 public:
  SheetSolver(const PhantomScene& scene, int stage, const View& view);

  /// The surface at material coordinates, in the camera frame.
  SurfaceSample sample(const Eigen::Vector2d& material) const;

  /// Nearest hit of the ray (direction, 1), which passes through pixel (column, row) or within a pixel of it.
  std::optional<SheetHit> nearest(const Eigen::Vector2d& direction, int column, int row) const;

  /// Newton from a start; nothing where it does not settle on the camera's side of the surface.
  std::optional<SheetHit> solve(const Eigen::Vector2d& direction, const Eigen::Vector2d& start) const;

  /// Whether more than one sheet of the surface may be seen near the pixel.
  bool isFolded(int column, int row) const { return folded_(row, column) != 0; }

  /// Camera in the brain frame.
  const Eigen::Isometry3d& T_brain_camera() const { return T_brain_camera_; }

 private:
  void buildStarts();

  const PhantomScene& scene_;
  int stage_;
  const View& view_;
  Eigen::Isometry3d T_brain_camera_, T_camera_brain_;
  cv::Mat_<cv::Vec2f> starts_;  // material coordinates of the coarse mesh per pixel; NaN where there is none
  cv::Mat_<uchar> folded_;
};

}  // namespace cortshift_stereo_phantom
