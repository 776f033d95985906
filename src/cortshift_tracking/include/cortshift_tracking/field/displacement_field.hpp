// Dense 3D displacement over the grid of a projection frame.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_tracking/projection/projection_frame.hpp"

namespace cortshift_tracking {

/// All images have the size of the frame's grid.
struct DisplacementField {
  ProjectionFrame frame;
  cv::Mat start_pmr;         ///< CV_32FC3 x y z on the earlier surface [m]; NaN where there is no trusted displacement
  cv::Mat displacement_pmr;  ///< CV_32FC3 dx dy dz to the later surface [m]; NaN in the same places
  cv::Mat colour;            ///< CV_8UC3 of the earlier surface
  cv::Mat confidence;        ///< CV_32FC1 0...1; below the gate the vectors are NaN
  cv::Mat uncertainty;   ///< CV_32FC1 root mean square length expected of the vector's error [m], or empty: not known
  cv::Mat brain;         ///< CV_8UC1 255 on the exposed brain of the earlier surface, or empty: not known
  cv::Mat strain_major;  ///< CV_32FC1 as in Strain, or empty where it was not asked for
  cv::Mat strain_minor;  ///< CV_32FC1 as in Strain, or empty
};

}  // namespace cortshift_tracking
