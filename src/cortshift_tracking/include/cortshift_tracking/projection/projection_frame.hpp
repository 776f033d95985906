// The local coordinate system that both surfaces are projected onto (Ji et al. 2014, section 2.5, Fig. 3).
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "cortshift_stereo/geometry/surface.hpp"

namespace cortshift_tracking {

struct FrameSettings {
  double resolution = 0.0001;  ///< distance of neighbouring grid points [m], 0.00005 ... 0.001
  double margin = 0.0;         ///< what the grid covers beyond the earlier surface's bounding box [m], 0 ... 0.02

  /// @throws TrackingError naming the setting, its value and the allowed range.
  void validate() const;
};

/// A plane with a grid of points. Grid point (row, column) lies at (column * resolution, row * resolution, 0).
///
/// z is the average normal and points towards the camera, x follows the columns of the rectified left image, and the
/// frame is right-handed. So row 0 is at the BOTTOM of a picture as the camera sees it.
struct ProjectionFrame {
  Eigen::Isometry3d T_pmr_projection = Eigen::Isometry3d::Identity();  ///< [m]
  double resolution = 0;                                               ///< [m]
  cv::Size size;                                                       ///< columns x rows of the grid

  Eigen::Vector3d normal_pmr() const { return T_pmr_projection.linear().col(2); }
};

/// Average surface normal [unit, towards the camera], weighted by area. Facets across holes and depth steps do not
/// count, nor those that lean by more than 60 degrees from the median direction.
/// @throws TrackingError if the surface has too few connected points.
Eigen::Vector3d averageNormal(const cortshift_stereo::Surface& surface_pmr);

/// The frame of `surface_pmr` (the earlier one): z its average normal, the grid its bounding box; far outliers in
/// height do not widen the box.
/// @throws TrackingError if the surface has too few connected points or the grid would be unreasonably large.
ProjectionFrame fitProjectionFrame(const cortshift_stereo::Surface& surface_pmr, const FrameSettings& settings = {});

}  // namespace cortshift_tracking
