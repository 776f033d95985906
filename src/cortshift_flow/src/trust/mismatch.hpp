// How differently two images look under a flow: enough to tell right from wrong, not to measure.
#pragma once

#include "variational/coarse_to_fine.hpp"

namespace cortshift_flow {

/// A pixel's mismatch saturates here [intensity, 0...1, summed over the channels].
constexpr float kLargestMismatch = 0.2f;
/// The mismatch of a pixel whose match lies outside the second image or is excluded.
constexpr float kUnseen = 0.36f * kLargestMismatch;

/// Half width of the windows that tell whether two places look alike [px].
constexpr int kMatchWindow = 2;

/// Mismatch of pixels x0...x0 + count - 1 of row y under a flow; bilinear interpolation.
void mismatchRow(const Level& level, int x0, int y, const float* u, const float* v, float* out, int count);

/// Mean mismatch of the square window of half width `window` about each pixel.
Plane windowMismatch(const Level& level, const FlowPlanes& flow, int window, int threads);

/// Takes `other` in place of `flow` at eligible pixels (CV_8UC1, not 0) where windows then mismatch less.
void adoptWhereBetter(const Level& level, const FlowPlanes& other, const cv::Mat1b& eligible, FlowPlanes& flow,
                      int threads);

/// What counts as a mismatch for this pair of images, from what is usual for it.
struct MismatchScale {
  float suspect = 0;    ///< windows that mismatch by more should try another flow [intensity, summed over channels]
  float unmatched = 0;  ///< windows that mismatch by more than this do not show the same tissue [same unit]
};
MismatchScale mismatchScale(const Level& level, const FlowPlanes& flow, int threads);

/// 1 (CV_8UC1) where a pixel that counts flows to a place that the second image shows.
cv::Mat1b shown(const Level& level, const FlowPlanes& flow, int threads);

/// 1 where it is shown and a window about the pixel looks the same at both ends of its flow.
/// @param limit  largest mean mismatch [intensity, 0...1, summed over the channels]
cv::Mat1b matched(const Level& level, const FlowPlanes& flow, float limit, int threads);

}  // namespace cortshift_flow
