// A textured surface seen along the normal of a projection frame (Ji et al. 2014, section 2.5).
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo/geometry/surface.hpp"
#include "cortshift_tracking/projection/projection_frame.hpp"

namespace cortshift_tracking {

struct ProjectionSettings {
  double max_edge_ratio = 6;  ///< triangles with a longer edge than this times the median spacing are cut, 2 ... 50
  double fold_tolerance = 0.0003;  ///< layers over one grid point further apart than this are a fold [m], 0 ... 0.01
  int threads = 0;                 ///< 0: all that OpenCV has; the result does not depend on it

  /// @throws TrackingError naming the setting, its value and the allowed range.
  void validate() const;
};

/// Images over the grid of a frame, rows x columns. What is not covered by the surface is 0 in `mask`.
struct Projection {
  cv::Mat colour;      ///< CV_32FC3 blue green red, 0...1; 0 outside the mask
  cv::Mat height;      ///< CV_32FC1 [m] along the frame's z; NaN outside the mask
  cv::Mat confidence;  ///< CV_32FC1 0...1 of the surface; 0 outside the mask
  cv::Mat source;      ///< CV_32FC2 (column, row) in the surface's image; NaN outside the mask
  cv::Mat mask;        ///< CV_8UC1 255 where the surface covers the grid point
  cv::Mat fold;        ///< CV_8UC1 255 where the surface covers the grid point more than once

  /// CV_32FC3, size of the surface's image: its points in grid units (column, row, height / resolution); NaN: none.
  cv::Mat vertices;
  float max_edge = 0;     ///< longest edge of an uncut triangle [grid units]
  double resolution = 0;  ///< of the frame [m]
};

/// Projects by linear interpolation within the triangles of the organised mesh, so that (column, row, height) of each
/// grid point is a point of the surface; colours by cubic interpolation of the surface's image at that same point.
/// Where layers overlap the one nearest to the camera is taken.
/// @throws TrackingError if the surface's images do not fit together.
Projection project(const cortshift_stereo::Surface& surface_pmr, const ProjectionFrame& frame,
                   const ProjectionSettings& settings = {});

}  // namespace cortshift_tracking
