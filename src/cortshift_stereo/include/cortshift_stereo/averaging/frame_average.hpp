// Several pairs of one view to one surface: noise and the pulsation of the brain average out.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "cortshift_stereo/geometry/camera_model.hpp"
#include "cortshift_stereo/reconstruction.hpp"

namespace cortshift_stereo {

/// What of a reconstruction is kept for averaging.
struct Frame {
  cv::Mat disparity;   ///< CV_32FC1 [px], NaN where invalid
  cv::Mat colour;      ///< CV_8UC3
  cv::Mat confidence;  ///< CV_32FC1
};

/// Robust mean per pixel of frames of one calibration and one pose: the mean of the disparities near their median,
/// where at least half of the frames have one. The confidence follows from the confidences of the frames and from how
/// much their disparities differ.
/// @param frames  at least one, of one size
/// @returns disparity and surface (raw left camera frame); quality and seconds are left alone
ReconstructionResult averageFrames(const std::vector<Frame>& frames, const StereoModel& model);

}  // namespace cortshift_stereo
