// Pictures of a result for people: upright as the camera saw the earlier stage, about 1024 pixels wide, with a scale.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_tracking/shift.hpp"

namespace cortshift_tracking {

/// Both stages over each other: red earlier, green later; what has not moved is yellow. CV_8UC3 (blue green red). This
/// and the maps below show the outline of the brain as a white line, where it is known.
cv::Mat overlayBefore(const ShiftResult& result);

/// The same with the later stage brought back by the flow; a thin line surrounds what is trusted.
cv::Mat overlayAfter(const ShiftResult& result);

/// The earlier stage with the outline of the brain, where it is known.
cv::Mat brainOutline(const ShiftResult& result);

/// |d| in colours, with a colour bar in mm; blank (dark grey) where there is no vector.
cv::Mat magnitudeMap(const DisplacementField& field);

/// Components of d as in the paper's Table 3. The signed ones: blue against, white none, red along the direction.
/// `gravity_pmr` and `first_normal_pmr` have unit length.
cv::Mat gravityMap(const DisplacementField& field, const Eigen::Vector3d& gravity_pmr);
cv::Mat normalMap(const DisplacementField& field, const Eigen::Vector3d& first_normal_pmr);
cv::Mat lateralMap(const DisplacementField& field, const Eigen::Vector3d& first_normal_pmr);

/// Colour (blue green red) of a value out of [0, 1] on the scale of magnitudeMap.
cv::Vec3b scaleColour(double value);

/// Upper end of a colour scale over the field's magnitudes [m]: their 99th percentile, rounded up to 1, 1.5, 2, 3, 4,
/// 5, 6, 8 or 10 times a power of ten, and not less than 0.1 mm.
double scaleEnd(const DisplacementField& field);

}  // namespace cortshift_tracking
