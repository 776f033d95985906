#include "confidence.hpp"

#include <algorithm>
#include <cmath>

#include "mismatch.hpp"
#include "parallel.hpp"
#include "spline_grid.hpp"

namespace cortshift_flow {
namespace {

constexpr float kHalfConfidence = 0.25f;  // predicted error at which the confidence is one half [px]

}  // namespace

float confidenceOf(float predicted_error) {
  const float ratio = predicted_error / kHalfConfidence;
  return 1 / (1 + ratio * ratio);
}

cv::Mat1f predictConfidence(const Level& level, const FlowPlanes& flow, const FlowPlanes& backward_half,
                            const cv::Mat1b& visible, const PolishedFlow& polished, float mismatch, int threads) {
  (void)backward_half;
  cv::Mat1f confidence(level.first.size());
  const Plane mean = windowMismatch(level, flow, 2, threads);
  for (int y = 0; y < confidence.rows; ++y)
    for (int x = 0; x < confidence.cols; ++x) {
      float error = 0.05f;
      if (!visible(y, x)) error = 0.5f;
      if (!polished.regular(y / 4, x / 4)) error = 0.5f;
      if (mean.row(y)[x] > 2 * mismatch) error = 1;
      if (!level.first_valid.empty() && !level.first_valid(y, x))
        confidence(y, x) = 0;
      else
        confidence(y, x) = confidenceOf(error);
    }
  return confidence;
}

}  // namespace cortshift_flow
