#include "trust/confidence.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "cortshift_flow/confidence.hpp"
#include "cortshift_flow/flow.hpp"
#include "parallel.hpp"
#include "polish/spline_grid.hpp"
#include "trust/mismatch.hpp"

namespace cortshift_flow {
namespace {

constexpr float kHalfConfidence = 0.25f;   // predicted error at which the confidence is one half [px]
constexpr float kLeastError = 0.01f;       // [px]
constexpr float kPerHiddenPixel = 0.021f;  // growth of the error with the distance from what is visible [px / px]
constexpr float kNoiseInformation = 45;    // that a node seems to have from the gradients of noise alone [1 / px^2]
constexpr float kLeastShown = 0.05f;       // smallest share of a node's information that is taken as real, not as noise
constexpr float kPerBend = 6;              // error by smoothing, per second difference and root of information
constexpr float kPerSquaredBend = 2.5f;    // and per squared second difference: bends between two nodes [1 / px]
constexpr float kAtBoundary = 1;           // at a motion boundary [px]
constexpr float kUnmatched = 1;            // where visible tissue does not look like its match [px]
constexpr float kLeastUnmatched = 0.065f;  // mean mismatch below which it looks alike [intensity, summed over channels]
constexpr double kNearby = 1.5, kAround = 4;  // standard deviations over which nodes are averaged [nodes]

/// Root mean square of the flow's second differences around each node, motion boundaries apart [px].
cv::Mat1f bend(const FlowPlanes& nodes) {
  const int width = nodes.u.width(), height = nodes.u.height();
  cv::Mat1f squares(height, width, 0.f), mean;
  for (int y = 1; y + 1 < height; ++y)
    for (int x = 1; x + 1 < width; ++x) {
      float sum = 0;
      for (const Plane* p : {&nodes.u, &nodes.v}) {
        const float *above = p->row(y - 1), *here = p->row(y), *below = p->row(y + 1);
        const float xx = here[x - 1] - 2 * here[x] + here[x + 1], yy = above[x] - 2 * here[x] + below[x],
                    xy = below[x + 1] - below[x] - here[x + 1] + here[x];
        sum += xx * xx + yy * yy + 2 * xy * xy;
      }
      squares(y, x) = sum > 1 ? 0 : sum;
    }
  cv::GaussianBlur(squares, mean, cv::Size(), kNearby);
  cv::sqrt(mean, mean);
  return mean;
}

/// Predicted error at each node from the noise and from the smoothing [px]. With data of information J and a flow
/// expected to curve by c, the data are averaged over a patch of area 1 / (c sqrt(J)), which leaves a variance of
/// c / (pi sqrt(J)) (the posterior of a thin plate), and a flow that bends is flattened in proportion to 1 / sqrt(J).
cv::Mat1f nodeError(const PolishedFlow& polished, float curvature) {
  cv::Mat1f information(polished.information.size()), nearby, around;
  for (int j = 0; j < information.rows; ++j)
    std::copy_n(polished.information.row(j), information.cols, information.ptr<float>(j));
  cv::GaussianBlur(information, nearby, cv::Size(), kNearby);
  cv::GaussianBlur(information, around, cv::Size(), kAround);
  cv::Mat1f error = bend(polished.nodes);
  for (int j = 0; j < error.rows; ++j)
    for (int i = 0; i < error.cols; ++i) {
      const float bent = error(j, i), expected = std::hypot(curvature, 0.2f * bent);
      const float shown = std::min(nearby(j, i), around(j, i));
      const float root = std::sqrt(std::max({shown - kNoiseInformation, kLeastShown * shown, 1e-3f}));
      error(j, i) = std::sqrt(expected / (static_cast<float>(CV_PI) * root)) +
                    std::hypot(kPerBend * bent / root, kPerSquaredBend * bent * bent);
    }
  return error;
}

}  // namespace

double predictedError(double confidence) { return errorOfConfidence(confidence, kHalfConfidence); }

cv::Mat1f predictError(const Level& level, const FlowPlanes& flow, const cv::Mat1b& visible,
                       const PolishedFlow& polished, float curvature, float suspect, int threads) {
  const Plane mismatch = windowMismatch(level, flow, kMatchWindow, threads);
  const float unmatched = std::max(2 * suspect, kLeastUnmatched);
  const cv::Mat1f at_node = nodeError(polished, curvature);
  cv::Mat1f error;
  cv::distanceTransform(visible == 0, error, cv::DIST_L2, 3, CV_32F);
  forRows(error.rows, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) {
      const uchar* valid = level.first_valid.empty() ? nullptr : level.first_valid.ptr(y);
      const uchar *regular = polished.regular.ptr(y / SplineGrid::kSpacing), *seen = visible.ptr(y);
      const float *node = at_node.ptr<float>(y / SplineGrid::kSpacing + 1),
                  *node_below = at_node.ptr<float>(y / SplineGrid::kSpacing + 2), *mismatches = mismatch.row(y);
      float* out = error.ptr<float>(y);
      for (int x = 0; x < error.cols; ++x) {
        const int i = x / SplineGrid::kSpacing;
        float e = kLeastError + kPerHiddenPixel * out[x] + std::max(node[i + 1], node_below[i + 2]);
        if (!regular[i]) e = std::max(e, kAtBoundary);
        if (seen[x] && mismatches[x] > unmatched) e = std::max(e, kUnmatched);
        out[x] = valid && !valid[x] ? std::numeric_limits<float>::infinity() : e;
      }
    }
  });
  return error;
}

cv::Mat1f confidenceFromError(const cv::Mat1f& error, int l, cv::Size size, int threads) {
  cv::Mat1f confidence(size);
  const auto scale = static_cast<float>(1 << l) / kHalfConfidence;
  forRows(size.height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < size.width; ++x) {
        const float ratio = scale * error(y >> l, x >> l);
        confidence(y, x) = confidenceOfSquares(ratio * ratio);
      }
  });
  return confidence;
}

}  // namespace cortshift_flow
