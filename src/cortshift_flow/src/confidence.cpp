#include "confidence.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "cortshift_flow/flow.hpp"
#include "mismatch.hpp"
#include "parallel.hpp"
#include "spline_grid.hpp"

namespace cortshift_flow {
namespace {

constexpr float kHalfConfidence = 0.25f;    // predicted error at which the confidence is one half [px]
constexpr float kLeastError = 0.02f;        // of visible, textured tissue [px]
constexpr float kPerHiddenPixel = 0.021f;   // growth of the error with the distance from what is visible [px / px]
constexpr float kPerCurvature = 4.f;        // error per second difference of the flow over a node [px / px]
constexpr float kAtBoundary = 1;            // at a motion boundary [px]
constexpr float kUnmatched = 1;             // where visible tissue does not look like its match [px]
constexpr float kTextureInformation = 100;  // information of a node below which texture is missing [1 / px^2]
constexpr int kWindow = 2;                  // [px]

/// Largest second difference of the flow along the axes at each node [px].
Plane curvatureOfNodes(const FlowPlanes& nodes) {
  const int width = nodes.u.width(), height = nodes.u.height();
  Plane curvature(height, width);
  for (int y = 1; y + 1 < height; ++y)
    for (int x = 1; x + 1 < width; ++x) {
      float largest = 0;
      for (const Plane* p : {&nodes.u, &nodes.v}) {
        const float centre = 2 * p->row(y)[x];
        largest = std::max(largest, std::abs(p->row(y)[x - 1] - centre + p->row(y)[x + 1]));
        largest = std::max(largest, std::abs(p->row(y - 1)[x] - centre + p->row(y + 1)[x]));
      }
      curvature.row(y)[x] = largest;
    }
  return curvature;
}

}  // namespace

float confidenceOf(float predicted_error) {
  const float ratio = predicted_error / kHalfConfidence;
  return 1 / (1 + ratio * ratio);
}

double predictedError(double confidence) {
  return confidence > 0 ? kHalfConfidence * std::sqrt(std::max(0.0, 1 / confidence - 1))
                        : std::numeric_limits<double>::infinity();
}

cv::Mat1f predictConfidence(const Level& level, const FlowPlanes& flow, const cv::Mat1b& visible,
                            const PolishedFlow& polished, float mismatch, int threads) {
  cv::Mat1f confidence(level.first.size());
  const Plane mean = windowMismatch(level, flow, kWindow, threads);
  const Plane curvature = curvatureOfNodes(polished.nodes);
  // Featureless nodes are as unknown as hidden pixels: the distance is counted through both.
  cv::Mat1b known(confidence.size());
  for (int y = 0; y < known.rows; ++y)
    for (int x = 0; x < known.cols; ++x) {
      const float information = polished.information.row(y / SplineGrid::kSpacing + 1)[x / SplineGrid::kSpacing + 1];
      known(y, x) = visible(y, x) && information > kTextureInformation;
    }
  cv::Mat hidden_distance;
  cv::distanceTransform(known == 0, hidden_distance, cv::DIST_L2, 3, CV_32F);
  forRows(confidence.rows, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < confidence.cols; ++x) {
        if (!level.first_valid.empty() && !level.first_valid(y, x)) {
          confidence(y, x) = 0;
          continue;
        }
        const int j = y / SplineGrid::kSpacing, i = x / SplineGrid::kSpacing;
        float error = kLeastError + kPerHiddenPixel * hidden_distance.at<float>(y, x) +
                      kPerCurvature * std::max(curvature.row(j + 1)[i + 1], curvature.row(j + 2)[i + 2]);
        if (!polished.regular(j, i)) error = std::max(error, kAtBoundary);
        if (visible(y, x) && mean.row(y)[x] > 2 * mismatch) error = std::max(error, kUnmatched);
        confidence(y, x) = confidenceOf(error);
      }
  });
  return confidence;
}

}  // namespace cortshift_flow
