// What a vector may be off by, from everything known.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "cortshift_tracking/field/displacement_field.hpp"
#include "cortshift_tracking/field/summary.hpp"
#include "cortshift_tracking/surround/surround.hpp"

namespace cortshift_tracking {

/// CV_32FC1 [m] root mean square length of each vector's error: its own (match and heights) and what all vectors have
/// in common; NaN where there is no vector.
cv::Mat uncertaintyOf(const DisplacementField& field, const Surround& surround);

/// What all vectors have in common, and everything source by source, at the centre of the brain (of the field where no
/// outline is known).
void addBudget(Summary& summary, const DisplacementField& field, const Surround& surround);

}  // namespace cortshift_tracking
