// How noisy the difference between the images is.
#pragma once

#include "variational/coarse_to_fine.hpp"
#include "variational/data_term.hpp"

namespace cortshift_flow {

/// Inverse variance of each channel's difference between matching pixels, from the median absolute difference
/// [1 / intensity^2]; quantisation keeps it finite.
cv::Vec4f noiseWeights(const ImagePair& images, const FlowPlanes& flow, const cv::Mat1b& visible);

}  // namespace cortshift_flow
