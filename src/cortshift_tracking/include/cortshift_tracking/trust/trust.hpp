// Where a displacement can be believed (Ji et al. 2014, section 2.7.2 and Discussion).
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_tracking/matching/image_matching.hpp"
#include "cortshift_tracking/projection/projection.hpp"
#include "cortshift_tracking/trust/agreement.hpp"
#include "cortshift_tracking/trust/probability.hpp"

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

/// What is known of each vector of a flow, to judge it by.
struct VectorEvidence {
  double resolution = 0;    ///< of the grid [m]
  cv::Mat flow_confidence;  ///< CV_32FC1 0...1, of the image matching
  Agreement agreement;
  cv::Mat roughness;      ///< CV_32FC1 [m], see HeightEvidence
  cv::Mat height_errors;  ///< CV_32FC1 [m] standard deviation of each vector's change of height
  cv::Mat allowed;        ///< CV_8UC1 255: start and end of the vector are usable and far enough from the border
};

/// @param match the images are compared by the channels that the flow saw; all three by their luminance
/// @param height_errors CV_32FC1 [m]
VectorEvidence evidenceOf(const Projection& earlier, const Projection& later, const ProjectionMatch& match,
                          const cv::Mat& height_errors, const cv::Mat& earlier_usable, const cv::Mat& later_usable,
                          const TrustSettings& settings = {});

/// CV_32FC1 0...1 over the earlier image, of the images alone: see the other functions of this name.
cv::Mat probabilityOfMatch(const VectorEvidence& evidence);

/// CV_32FC1 0...1 over the earlier image, the probability that a vector is right to 0.25 mm: probabilityOfMatch times
/// probabilityOfHeight; 0 where a vector is not allowed, and in patches smaller than four windows in which the images
/// are compared.
/// @param probability_of_match of the evidence
cv::Mat confidenceOf(const VectorEvidence& evidence, const cv::Mat& probability_of_match,
                     const TrustSettings& settings = {});

}  // namespace cortshift_tracking
