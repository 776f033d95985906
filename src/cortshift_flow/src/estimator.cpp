#include "estimator.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "images/noise.hpp"
#include "images/photometric.hpp"
#include "images/prepare.hpp"
#include "polish/piecewise.hpp"
#include "polish/polish.hpp"
#include "polish/spline_grid.hpp"
#include "start/exchange.hpp"
#include "start/rough_flow.hpp"
#include "trust/confidence.hpp"
#include "trust/mismatch.hpp"
#include "trust/occlusion.hpp"

namespace cortshift_flow {
namespace {

constexpr int kPolishLevel = 2;          // from this level on the polish takes over from Eq. (5)
constexpr int kStiffLinearisations = 2;  // of the first polish, whose start is too rough to show curvature
constexpr int kConjugateGradients = 60;  // per linearisation
constexpr float kAgreement = 1;          // of forward and backward flow [px of the level]

/// One polish at a level, with the noise learned from what `visible` shows.
PolishedFlow polishAt(const Level& level, int l, const cv::Mat1b& visible, const FlowPlanes& start, int linearisations,
                      int stiff, const FlowSettings& settings, int threads) {
  const ImagePair pair{level.first, splineCoefficients(level.second, threads), level.first_valid, level.second_valid};
  PolishEffort effort;
  effort.linearisations = linearisations;
  effort.stiff_linearisations = stiff;
  effort.solver_iterations = kConjugateGradients;
  // Each coarser level has pixels and node distances twice as large: the same bend of the tissue then has twice the
  // second difference.
  effort.curvature = static_cast<float>(settings.curvature * (1 << l));
  return polish(pair, noiseWeights(pair, start, visible), visible, start, effort, threads);
}

/// 1 where the flow of a pixel is confirmed by its colours or by the opposite flow.
cv::Mat1b confirmed(const Level& level, const FlowPlanes& flow, const FlowPlanes& opposite, float unmatched,
                    int threads) {
  return matched(level, flow, unmatched, threads) |
         (consistent(flow, opposite, kAgreement, threads) & shown(level, flow, threads));
}

/// Non-zero where a pixel is hidden in the second image: its flow ends inside that image, but on other tissue.
/// @param uncovered  non-zero at pixels to which no pixel of the second image flows back
cv::Mat1b findOccluded(const Level& level, const FlowBothWays& flow, const cv::Mat1b& uncovered, float unmatched,
                       int threads) {
  cv::Mat1b seen = confirmed(level, flow.forward, flow.backward, unmatched, threads);
  // Single pixels are noise, not occlusion.
  cv::morphologyEx(seen, seen, cv::MORPH_CLOSE, cv::Mat::ones(7, 7, CV_8U));
  cv::Mat1b occluded = (uncovered | (seen == 0)) & (shown(level, flow.forward, threads) != 0);
  // The flow beside a hidden region is uncertain, and the flow inside it is continued from there: hide a rim as well.
  cv::dilate(occluded, occluded, cv::Mat::ones(5, 5, CV_8U));
  return occluded;
}

/// Share of uncertain pixels, among the valid ones whose match lies inside the second image.
float shareUnsure(const cv::Mat1f& error, const FlowPlanes& flow) {
  constexpr float kUnsure = 0.25f;  // [px of the level]
  int all = 0, unsure = 0;
  for (int y = 0; y < error.rows; y += 2)
    for (int x = 0; x < error.cols; x += 2) {
      const float px = static_cast<float>(x) + flow.u.row(y)[x], py = static_cast<float>(y) + flow.v.row(y)[x];
      if (!(px >= 0 && py >= 0 && px < static_cast<float>(error.cols) && py < static_cast<float>(error.rows))) continue;
      if (std::isinf(error(y, x))) continue;
      ++all;
      unsure += error(y, x) > kUnsure;
    }
  return all > 0 ? static_cast<float>(unsure) / static_cast<float>(all) : 0.f;
}

}  // namespace

Estimate estimateFlow(const Level& images, const FlowSettings& settings, int threads) {
  const std::vector<Level> levels = searchPyramid(images, threads);
  const int start = std::min(static_cast<int>(levels.size()) - 1, kPolishLevel);
  FlowBothWays flow = roughFlow(levels, start, settings, threads);

  // Make both images equally bright: from here on colours are compared directly.
  BrightnessMap brightness =
      BrightnessMap::fit(levels[static_cast<std::size_t>(start)], flow.forward, coveredBy(flow.backward), threads);

  // Second-order polish from coarse to fine; at each level but the finest first the boundaries and what is hidden.
  Level level;
  cv::Mat1b uncovered, occluded, visible;
  PolishedFlow polished;
  MismatchScale scale;
  const int finest_level = std::min(settings.finest_level, start);
  for (int l = start; l >= finest_level; --l) {
    level = levels[static_cast<std::size_t>(l)];
    if (brightness.significant()) level.first = brightness.apply(level.first, threads);
    level = interpolableLevel(level);
    const cv::Size size = level.first.size();
    if (flow.forward.u.size() != size) flow.forward = doubled(flow.forward, size, threads);
    const bool finest = l == 0 && start > 0;
    if (finest) {
      cv::resize(occluded, occluded, size, 0, 0, cv::INTER_NEAREST);
      cv::resize(uncovered, uncovered, size, 0, 0, cv::INTER_NEAREST);
    } else {
      scale = mismatchScale(level, flow.forward, threads);
      const Level backward = interpolableLevel(
          {level.second, level.first, levels[static_cast<std::size_t>(l)].second_valid, level.first_valid});
      if (l == start) {
        exchangeFlow(backward, exchangeReaches(), kMatchWindow, scale.suspect, {}, flow.backward, threads);
        const cv::Mat1b seen = matched(backward, flow.backward, scale.unmatched, threads) & coveredBy(flow.forward);
        flow.backward = evaluate(polishAt(backward, l, seen, flow.backward, 4, kStiffLinearisations, settings, threads),
                                 flow.backward, threads);
      } else {
        flow.backward = doubled(flow.backward, size, threads);
      }
      const cv::Mat1b trusted = confirmed(backward, flow.backward, flow.forward, scale.unmatched, threads);
      uncovered = coveredBy(flow.backward, trusted) == 0;
      exchangeFlow(level, exchangeReaches(), kMatchWindow, scale.suspect, uncovered, flow.forward, threads);
      occluded = findOccluded(level, flow, uncovered, scale.unmatched, threads);
    }
    visible = shown(level, flow.forward, threads) & (occluded == 0);
    if (!finest) continueFlow(level.first, visible, Continue::kByColour, flow.forward, threads);
    polished = polishAt(level, l, visible, flow.forward,
                        finest ? settings.full_polish_iterations : settings.coarse_polish_iterations,
                        l == start ? kStiffLinearisations : 0, settings, threads);
    flow.forward = evaluate(polished, flow.forward, threads);
    if (l > 0 && brightness.significant())
      brightness = BrightnessMap::fit(levels[static_cast<std::size_t>(l)], flow.forward, visible, threads);
  }
  cv::Mat1b settled;
  cv::resize(polished.regular, settled, cv::Size(), SplineGrid::kSpacing, SplineGrid::kSpacing, cv::INTER_NEAREST);
  settled = settled(cv::Rect(cv::Point(), level.first.size())) | (uncovered != 0);
  exchangeFlow(level, {6, 12}, 1, scale.suspect, settled, flow.forward, threads);

  Estimate estimate;
  cv::Mat1f error = predictError(level, flow.forward, visible, polished,
                                 static_cast<float>(settings.curvature * (1 << finest_level)), scale.suspect, threads);
  // Only at full resolution: a preset that stops at a coarser level is chosen for its speed, and this fit is slow.
  if (finest_level == 0 && shareUnsure(error, flow.forward) > static_cast<float>(settings.most_unsure)) {
    PiecewiseFlow piecewise = piecewiseFlow(levels, start, finest_level, settings, threads);
    flow.forward = std::move(piecewise.flow);
    error = piecewise.error;
  }
  estimate.confidence = confidenceFromError(error, finest_level, images.first.size(), threads);
  if (!images.first_valid.empty()) estimate.confidence.setTo(0, images.first_valid == 0);
  for (int l = finest_level - 1; l >= 0; --l)
    flow.forward = doubled(flow.forward, levels[static_cast<std::size_t>(l)].first.size(), threads);
  estimate.flow = std::move(flow.forward);
  return estimate;
}

}  // namespace cortshift_flow
