// From motion in the plane back to space: the inverse of the projection (Ji et al. 2014, section 2.5, Fig. 3).
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "cortshift_tracking/field/displacement_field.hpp"
#include "cortshift_tracking/projection/projection.hpp"

namespace cortshift_tracking {

enum class Interpolation {
  kLinear,  ///< height on the triangle of the later surface at that place
  kNearest  ///< height of the nearest grid point, the paper's fast option (Discussion)
};

struct InversionSettings {
  Interpolation interpolation = Interpolation::kLinear;
  double min_confidence = 0.5;  ///< vectors below it become NaN, 0 ... 1; those of confidence 0 always do
  int threads = 0;              ///< 0: all that OpenCV has; the result does not depend on it

  /// @throws TrackingError naming the setting, its value and the allowed range.
  void validate() const;
};

/// Height of the surface [m] over any place (column, row) of the grid; empty where the surface is not.
std::optional<double> heightAt(const Projection& projection, double column, double row, Interpolation interpolation);

/// Displacement of each grid point x: from the earlier surface at x to the later surface at x + u(x).
/// @param flow CV_32FC2 u [grid units]
/// @param confidence CV_32FC1 0...1
DisplacementField invert(const ProjectionFrame& frame, const Projection& earlier, const Projection& later,
                         const cv::Mat& flow, const cv::Mat& confidence, const InversionSettings& settings = {});

/// The paper's alternative: displacement of the earlier surface's own points (u interpolated linearly between the grid
/// points around each). @return CV_32FC3 [m] in pmr, size of the earlier surface's image; NaN where not trusted.
cv::Mat displacementsOfPoints(const ProjectionFrame& frame, const Projection& earlier, const Projection& later,
                              const cv::Mat& flow, const cv::Mat& confidence, const InversionSettings& settings = {});

}  // namespace cortshift_tracking
