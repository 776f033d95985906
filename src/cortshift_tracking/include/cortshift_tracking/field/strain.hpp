// Strain within the cortical surface (Ji et al. 2011): how the surface itself stretches, whatever it moves.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_tracking/field/displacement_field.hpp"

namespace cortshift_tracking {

struct StrainSettings {
  double window = 0.004;  ///< side of the window in which the field is fitted by a plane [m], 0.0005 ... 0.02
  int threads = 0;        ///< 0: all that OpenCV has; the result does not depend on it

  /// @throws TrackingError naming the setting, its value and the allowed range.
  void validate() const;
};

/// Principal in-plane strains over the grid: length of a fibre later over its length earlier, minus 1. NaN where there
/// is no displacement or too few around it.
struct Strain {
  cv::Mat major;  ///< CV_32FC1, the larger (stretch > 0)
  cv::Mat minor;  ///< CV_32FC1, the smaller (compression < 0)
};

/// Local linear fits of earlier and later positions give the two tangent planes; the metric tensors G and g of both
/// give the principal stretches, which are the square roots of the eigenvalues of G^-1 g. Rigid motion gives 0 exactly.
Strain surfaceStrain(const DisplacementField& field, const StrainSettings& settings = {});

}  // namespace cortshift_tracking
