// What the images say of a flow after it was fitted: what tells right from wrong without the fit's own word.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "variational/coarse_to_fine.hpp"
#include "variational/data_term.hpp"

namespace cortshift_flow {

/// One number for each kind of evidence; all but the last are natural logarithms.
enum Cue {
  kFitError,       ///< the error that the fit predicts of itself [px]
  kNearStep,       ///< least-squares step that a window of about 5 px still asks for [px]
  kWideStep,       ///< and one of about 13 px [px]
  kStepsAround,    ///< root mean square of the near steps around [px]
  kNearNoise,      ///< standard deviation of the near step from the images' noise [px]
  kWideNoise,      ///< and of the wide one [px]
  kResidual,       ///< root mean square of what is left of the images' difference, in units of its noise
  kResidualShift,  ///< the same over the gradients: the shift that would explain it [px]
  kReturn,         ///< from where following the flow and then the opposite flow leads, to the start [px]
  kModels,         ///< between the flows of two models [px]
  kBend,           ///< root mean square second difference of the flow over 4 px around [px]
  kHidden,         ///< share of the window that is hidden, at a boundary, or outside (0...1)
  kCues
};

/// Names of the cues in their order, for the program that fits their weights.
const std::vector<std::string>& cueNames();

/// What a flow is judged by.
struct Judged {
  const ImagePair& images;
  cv::Vec4f channel_weights;   ///< inverse noise variance of each channel's difference
  const FlowPlanes& flow;      ///< at every pixel of the level
  const FlowPlanes& backward;  ///< from the second image to the first, of the same level or of half its size
  const FlowPlanes& other;     ///< of another model, same size
  const cv::Mat1b& regular;    ///< 1 where a pixel is seen in both images and no boundary is near
  const cv::Mat1f& fit_error;  ///< per pixel [px]
};

/// CV_32FC(kCues) with one element for each pixel (4 i, 4 j) of the level.
cv::Mat gatherEvidence(const Judged& judged, int threads);

}  // namespace cortshift_flow
