// A textured, deformable analytic surface seen by virtual pinhole cameras: surfaces whose every point, and whose every
// displacement, are known in closed form.
#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <opencv2/core.hpp>

#include "cortshift_flow_phantom/cortical_texture.hpp"
#include "cortshift_stereo/geometry/surface.hpp"

namespace cortshift_tracking {

struct PinholeCamera {
  Eigen::Isometry3d T_pmr_camera;  ///< optical frame: z forward, x right, y down
  double focal_px;
  cv::Size size;
};

/// A shallow dome over material coordinates (a, b) [m] in a scene frame somewhere in pmr; its z points outward.
class AnalyticScene {
 public:
  /// Displacement of material point (a, b), in scene coordinates [m].
  using Deformation = std::function<Eigen::Vector3d(double a, double b)>;

  explicit AnalyticScene(const Eigen::Isometry3d& T_pmr_scene) : T_pmr_scene_(T_pmr_scene) {}

  static Deformation atRest();

  Eigen::Vector3d position_pmr(double a, double b, const Deformation& deformation) const;

  /// Material point at a place of the deformed surface.
  Eigen::Vector2d materialAt(const Eigen::Vector3d& point_pmr, const Deformation& deformation) const;

  /// Displacement from one state to another of the material at `point_pmr` of the first.
  Eigen::Vector3d displacement_pmr(const Eigen::Vector3d& point_pmr, const Deformation& from,
                                   const Deformation& to) const;

  /// `standoff` [m] above the scene's origin, looking at it: tilted by `tilt` [rad] about its x axis, moved sideways by
  /// `shift` [m] and rolled about its axis by `roll` [rad].
  PinholeCamera cameraAt(double standoff, double tilt, double shift, double roll, cv::Size size, double field) const;

  cortshift_stereo::Surface see(const PinholeCamera& camera, const Deformation& deformation) const;

 private:
  Eigen::Isometry3d T_pmr_scene_;
  cortshift_flow_phantom::CorticalTexture texture_;
};

/// A scene placed and turned in pmr like a craniotomy on the left side.
AnalyticScene standardScene();

/// Sags by `depth` and shifts sideways by `lateral` [m], both fading towards a rim that does not move.
AnalyticScene::Deformation sagAndShift(double depth, double lateral);

}  // namespace cortshift_tracking
