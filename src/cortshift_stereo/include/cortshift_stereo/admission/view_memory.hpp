// What the camera saw while its pose was said to be the same: a tracker that stands still shows in the images.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <memory>
#include <opencv2/core.hpp>

#include "cortshift_stereo/admission/verdict.hpp"

namespace cortshift_stereo {

/// The left images of the last minute, small, each with the pose that was said of it.
///
/// An image that is the same bit by bit as an earlier one although the camera has moved comes from a camera that stands
/// still. A pose that is the same bit by bit as an earlier one, stuck or gone back to, must show the same surroundings.
/// Only the corners of the image are compared: in the middle lies the brain, which moves.
class ViewMemory {
 public:
  /// @param image   CV_8UC3
  /// @param optics  stands for calibration and setting; images of other ones are not compared
  /// @returns refusal where an earlier image of this very pose shows other surroundings; then the image is not kept
  Findings add(int64_t stamp_ns, const Eigen::Isometry3d& T_pmr_left, const cv::Mat& image,
               const std::shared_ptr<const void>& optics);

 private:
  struct View {
    int64_t stamp_ns;
    Eigen::Isometry3d T_pmr_left;
    cv::Mat detail;
    std::shared_ptr<const void> optics;
  };
  std::deque<View> views_;  // in order of arrival
};

/// Whether the corners of two images of one camera show that it has moved in between: at least two of them have
/// texture, and none of those agrees. @param a, b  CV_8UC3 of one size
bool surroundingsMoved(const cv::Mat& a, const cv::Mat& b);

}  // namespace cortshift_stereo
