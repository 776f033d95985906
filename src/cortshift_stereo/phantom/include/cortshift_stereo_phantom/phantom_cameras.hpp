// The stereo head of the phantom's microscope and the views it takes.
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"
#include "cortshift_stereo_phantom/phantom_case.hpp"

namespace cortshift_stereo_phantom {

enum class Side { kLeft, kRight };

/// A camera at a place. Pixel (0, 0) is the centre of the first pixel.
struct View {
  cv::Size size;                       ///< [px]
  cv::Matx33d K = cv::Matx33d::eye();  ///< [px]
  cortshift_stereo::LensModel lens = cortshift_stereo::LensModel::kPlumbBob;
  std::vector<double> D;                                           ///< coefficients of the lens; empty: none
  Eigen::Isometry3d T_pmr_camera = Eigen::Isometry3d::Identity();  ///< optical axes: x right, y down, z ahead
  Eigen::Vector3d lamp_pmr{0, 0, 0};                               ///< [m]

  /// Direction (x, y, 1) in the camera frame that pixel (u, v) looks along, distortion removed to 1e-14.
  Eigen::Vector2d direction(double u, double v) const;

  /// Pixel of a point [m]; nothing where the point lies behind the camera.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_pmr) const;
};

/// Calibration of both cameras, all of it computed, nothing estimated.
struct StereoHead {
  cortshift_stereo::StereoModel model;
  Eigen::Isometry3d T_head_left;   ///< raw left camera in the head, whose origin is the middle of the baseline, x along
  Eigen::Isometry3d T_head_right;  ///< the baseline from left to right, z along the microscope's axis

  Eigen::Isometry3d T_left_right() const { return T_head_left.inverse() * T_head_right; }
};

/// Two verging cameras. The principal points of the rectified pair are chosen so that each view stays centred, so cx of
/// left and right differ and a point at the working distance has a disparity near 0.
StereoHead makeStereoHead(const CameraSettings& settings);

/// The head at other settings of its zoom lens: K, D and the cameras' places change. R and P stay those of the
/// reference setting, at which the stereo calibration was made. Without a zoom lens nothing changes.
StereoHead atSetting(const StereoHead& reference, const CameraSettings& settings, double magnification,
                     double focal_length);

/// Pose of the stereo head over the brain.
Eigen::Isometry3d placeHead(const PlacementSettings& placement);  // T_brain_head

/// The raw (distorted) image that one camera takes with the head at `T_pmr_head`.
View rawView(const StereoHead& head, const LightSettings& light, Side side, const Eigen::Isometry3d& T_pmr_head);

/// The rectified image of the same camera: pixels of P, frame turned by R.
View rectifiedView(const StereoHead& head, const LightSettings& light, Side side, const Eigen::Isometry3d& T_pmr_head);

}  // namespace cortshift_stereo_phantom
