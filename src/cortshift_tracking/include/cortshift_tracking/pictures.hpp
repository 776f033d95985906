// Pictures of a result for people: upright as the camera saw the earlier stage, about 1024 pixels wide, with a scale.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_tracking/shift.hpp"

namespace cortshift_tracking {

/// Both stages over each other: red earlier, green later; what has not moved is yellow. CV_8UC3 (blue green red).
cv::Mat overlayBefore(const ShiftResult& result);

/// The same with the later stage brought back by the flow; a thin line surrounds what is trusted.
cv::Mat overlayAfter(const ShiftResult& result);

/// |d| in colours over the grey earlier stage, with a colour bar in mm; blank (dark grey) where there is no vector.
cv::Mat magnitudeMap(const ShiftResult& result);

/// Colour (blue green red) of a value out of [0, 1] on the scale of magnitudeMap.
cv::Vec3b scaleColour(double value);

/// Upper end of a colour scale over magnitudes [m]: the 99th percentile, rounded up to 1, 1.5, 2, 3, 4, 5, 6, 8
/// or 10 times a power of ten, and not less than 0.1 mm.
double scaleEnd(const DisplacementField& field);

}  // namespace cortshift_tracking
