// The motion between two projection images (Ji et al. 2014, section 2.4 on the images of 2.5).
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "cortshift_flow/flow.hpp"
#include "cortshift_tracking/projection.hpp"

namespace cortshift_tracking {

struct RegistrationSettings {
  std::string channels = "rgb";  ///< rgb, green, blue or luminance: what the flow sees (paper, Discussion: bleeding)
  int more_rounds = 0;           ///< of flow where much is left unsure, each from the sure vectors around it, 0 ... 5
  cortshift_flow::FlowSettings flow;

  /// @throws TrackingError naming the setting, its value and what is allowed.
  void validate() const;
};

/// Flow [grid units] from the earlier to the later projection.
/// @param earlier_usable, later_usable CV_8UC1: 0 where the image must not count (holes, folds, glare, exclusions);
///        such pixels are filled from their surroundings and masked
cortshift_flow::FlowResult registerProjections(const Projection& earlier, const Projection& later,
                                               const cv::Mat& earlier_usable, const cv::Mat& later_usable,
                                               const RegistrationSettings& settings = {});

/// Continues an image smoothly where `mask` is 0.
/// @param image CV_32F with one to three channels
cv::Mat fillHoles(const cv::Mat& image, const cv::Mat& mask);

}  // namespace cortshift_tracking
