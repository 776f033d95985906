// Where a displacement can be believed (Ji et al. 2014, section 2.7.2 and Discussion).
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_tracking/projection/projection.hpp"
#include "cortshift_tracking/trust/agreement.hpp"

namespace cortshift_tracking {

struct TrustSettings {
  double border = 0.002;     ///< vectors nearer to the border of what both stages show are not reported [m], 0 ... 0.02
  double hole_border = 0.0;  ///< the same around large holes inside it [m], 0 ... 0.02
  double glare = 0.97;       ///< darkest channel above which a pixel is a highlight, 0.5 ... 1
  double glare_margin = 0.0004;  ///< around a highlight [m], 0 ... 0.01
  AgreementSettings agreement;

  /// @throws TrackingError naming the setting, its value and the allowed range.
  void validate() const;
};

/// CV_8UC1 255 where a projection may take part in matching: covered once, no highlight.
cv::Mat usableMask(const Projection& projection, const TrustSettings& settings = {});

/// CV_8UC1 255 further than `border` [grid units] inside the mask's outer boundary, and further than `hole_border` from
/// its large holes. Holes into which no disc of diameter `hole_border` fits do not grow. What is beyond the image
/// counts as outside.
cv::Mat erodeBorder(const cv::Mat& mask, double border, double hole_border);

/// Part of the earlier surface's projected area that the later surface covers too, 0...1 (0 if there is no area).
double overlapOf(const Projection& earlier, const Projection& later);

/// The confidence: CV_32FC1 0...1 over the earlier image, the probability that a vector is right to 0.25 mm:
/// probabilityOfMatch times probabilityOfHeight; 0 where the start or the end of a vector is not usable or too near to
/// the border, and in patches smaller than four windows in which the images are compared.
/// @param flow_confidence CV_32FC1 0...1, of the image matching
/// @param height_errors CV_32FC1 [m] standard deviation of each vector's change of height
cv::Mat combineConfidence(const Projection& earlier, const Projection& later, const cv::Mat& flow,
                          const cv::Mat& flow_confidence, const cv::Mat& height_errors, const cv::Mat& earlier_usable,
                          const cv::Mat& later_usable, const TrustSettings& settings = {});

}  // namespace cortshift_tracking
