// Smooth continuation of values into places where they are not known.
#pragma once

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// Replaces values of weight 0 by a continuation of the weighted others, from near to far (push-pull); zero flow if
/// no pixel has weight.
/// @param weight  0...1, size of the flow
void fillUnknown(FlowPlanes& flow, const cv::Mat1f& weight);

/// The same for the colours of an image; `valid` is 0 where they are not known. Nothing of an unknown colour, NaN
/// included, remains.
void fillUnknown(cv::Mat4f& image, const cv::Mat1b& valid);

}  // namespace cortshift_flow
