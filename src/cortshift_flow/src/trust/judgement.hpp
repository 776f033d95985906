// The error that a flow has, from what the images say of it.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_flow {

/// Which fit of the flow is judged; each has weights of its own.
enum class FitKind {
  kSmooth,       ///< where it was fitted alone
  kPiecewise,    ///< beside the smooth one
  kSmoothOfTwo,  ///< beside the piecewise one
};

/// Predicted error e (root mean square) at each pixel of a level [px of the level], infinite where `fit_error` is. A
/// logistic model of the evidence (trust/evidence.hpp), fitted by script/fit_trust flow, gives the odds that the vector
/// is off by more than 0.25 px; (e / 0.25 px)^2 is (e - 1) times the odds, as of an error whose components are normal.
/// @param evidence  of gatherEvidence()
/// @param fit_error  per pixel [px]
cv::Mat1f judgedError(const cv::Mat& evidence, FitKind kind, const cv::Mat1f& fit_error, int threads);

/// Share of what is in view (0...1) whose flow is judged unsure while its windows ask for a step well above its noise:
/// there another model may follow the images better. Where noise, blur or a lack of texture alone make it unsure,
/// nothing is to be gained.
/// @param error  of judgedError() with the same evidence
float shareContradicted(const cv::Mat& evidence, const cv::Mat1f& error);

}  // namespace cortshift_flow
