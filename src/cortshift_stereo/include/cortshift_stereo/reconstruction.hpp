// One stereo pair to a textured surface in the raw left camera frame (Ji et al. 2014, section 2.2).
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/admission/pair_quality.hpp"
#include "cortshift_stereo/geometry/surface.hpp"
#include "cortshift_stereo/matching/matching.hpp"
#include "cortshift_stereo/rectification/rectifier.hpp"

namespace cortshift_stereo {

/// What reconstruct() needs to know beside pair and calibration. Each default is written here and nowhere else.
struct ReconstructionSettings {
  double min_working_distance = 0.15;  ///< [m] nearest surface along the optical axis
  double max_working_distance = 0.60;  ///< [m] farthest one
  double relief = 0.004;               ///< [m] depth beyond what the coarse match sees, on either side
  double max_deviation = 0.75;         ///< [px] points that may be farther off (no texture) are left out
  PairLimits limits;

  /// @throws std::invalid_argument naming the setting, its value and the allowed range
  void validate() const;
};

/// How well a pair could be reconstructed.
struct ReconstructionQuality {
  SearchRange search_range;  ///< [px] disparities that were searched
  double coverage = 0;       ///< [0...1] share with a point of what the camera shows of the rectified left image
  RowAgreement epipolar;     ///< after a turn of the right camera was taken out
  ImageQuality left;
  ImageQuality right;
};

struct ReconstructionResult {
  cv::Mat disparity;     ///< CV_32FC1 of the rectified left image, x_left - x_right [px]; NaN where invalid
  Surface surface_left;  ///< in the raw left camera frame
  ReconstructionQuality quality;
  std::vector<std::string> warnings;  ///< what a person should know before believing this; empty: nothing
  double seconds = 0;                 ///< wall time from the raw images in memory to the surface
};

/// @param left, right  CV_8UC3 raw images
/// @throws PairError if the pair cannot give a surface that can be trusted
ReconstructionResult reconstruct(const cv::Mat& left, const cv::Mat& right, const Rectifier& rectifier,
                                 const ReconstructionSettings& settings = {});

}  // namespace cortshift_stereo
