// What a vector may be off by, from everything known.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "cortshift_tracking/field/displacement_field.hpp"
#include "cortshift_tracking/field/summary.hpp"
#include "cortshift_tracking/projection/projection.hpp"
#include "cortshift_tracking/surround/surround.hpp"

namespace cortshift_tracking {

/// What the vectors of a pair are made from.
struct Measured {
  const Projection &earlier, &later;
  const cv::Mat &flow, &flow_confidence;  ///< of the image matching, over the earlier image
  double earlier_pixel = 0;               ///< [m] that a pixel of disparity moves a point of the earlier surface by
  double later_pixel = 0;                 ///< the same of the later one
};

/// [m] that a pixel of disparity moves a point by: the width of a pixel on the surface times distance over baseline.
/// @param spacing  [m] of neighbouring points  @param camera  empty: at the working distance  @param baseline  [m]
double pixelOfDisparity(const Projection& projection, double spacing, const ProjectionFrame& frame,
                        const std::optional<PlacedCamera>& camera, double baseline);

/// CV_32FC1 [m] over the earlier image, standard deviation of each vector's change of height, as the two surfaces
/// expect.
cv::Mat heightErrorsOf(const Measured& measured);

/// CV_32FC1 [m] over the earlier image, root mean square length of each vector's own error: what the two surfaces and
/// the image matching expect of themselves; 10 mm at most.
/// @param height_errors  of heightErrorsOf
cv::Mat ownErrorsOf(const Measured& measured, const cv::Mat& height_errors);

/// CV_32FC1 [m] root mean square length of each vector's error: its own (match and heights) and what all vectors have
/// in common; NaN where there is no vector.
cv::Mat uncertaintyOf(const DisplacementField& field, const cv::Mat& own, const Surround& surround);

/// What all vectors have in common, and everything source by source, at the centre of the brain (of the field where no
/// outline is known).
void addBudget(Summary& summary, const DisplacementField& field, const cv::Mat& own, const Surround& surround);

}  // namespace cortshift_tracking
