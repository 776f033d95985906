// Regions that the user does not trust (Ji et al. 2014, Discussion: manually selected and excluded).
#pragma once

#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "cortshift_tracking/projection/projection_frame.hpp"

namespace cortshift_tracking {

/// Corners in a projection frame, x along columns and y along rows [m].
using Region = std::vector<cv::Point2d>;

/// CV_8UC1 over the frame's grid: 255 where a grid point lies in a region.
/// @throws TrackingError for a region of fewer than three corners or with a corner that is not finite
cv::Mat excludedMask(const ProjectionFrame& frame, const std::vector<Region>& regions);

/// CV_8UC1 over the frame's grid: 255 where a grid point lies in an odd number of outlines, so that one within another
/// is a hole. @throws TrackingError as above
cv::Mat outlinedMask(const ProjectionFrame& frame, const std::vector<Region>& outlines);

/// Reads regions by the key of the earlier stage:
///   KEY: [[[x, y], [x, y], [x, y]], ...]      [m]
/// @throws TrackingError naming the file and what is wrong
std::map<std::string, std::vector<Region>> readRegions(const std::string& path);

}  // namespace cortshift_tracking
