// A textured cortical surface, organised as the rectified left image that it was reconstructed from.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_stereo {

/// H x W points with colour. The frame of the points is in the name of the variable that holds the surface
/// (surface_left: raw left camera, surface_pmr: preoperative MR).
struct Surface {
  cv::Mat points;      ///< CV_32FC3 x y z [m]; NaN where there is no point
  cv::Mat colour;      ///< CV_8UC3 blue green red, defined everywhere
  cv::Mat confidence;  ///< CV_32FC1 0...1; 0 where there is no point

  cv::Size size() const { return points.size(); }
};

}  // namespace cortshift_stereo
