// Convex outlines in double precision, also of points on a line. boost::geometry's (1.74) repeats corners there, which
// would have to be taken out again, and compiles in 5.4 s instead of 2.1 s, with a note of a deprecated header each
// time.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace cortshift_stereo {

/// Corners of the convex hull, counter-clockwise in x right, y up; two points for points on a line, one for one point.
std::vector<cv::Point2d> convexHull(std::vector<cv::Point2d> points);

/// Inside or on the hull, or no farther from it than the tolerance.
bool insideHull(const std::vector<cv::Point2d>& hull, const cv::Point2d& point, double tolerance);

}  // namespace cortshift_stereo
