#include "estimator.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "coarse_search.hpp"
#include "confidence.hpp"
#include "exchange.hpp"
#include "high_pass.hpp"
#include "inverse_search.hpp"
#include "noise.hpp"
#include "occlusion.hpp"
#include "photometric.hpp"
#include "polish.hpp"
#include "prepare.hpp"
#include "spline_grid.hpp"

namespace cortshift_flow {
namespace {

constexpr int kSearchSide = 96;  // the search runs at the first level whose shorter side is below twice this [px]
constexpr int kPolishLevel = 2;  // from this level on the polish takes over from Eq. (5)

constexpr int kStiffLinearisations = 2;  // of the first polish, whose start is too rough to tell curvature from noise
constexpr int kWindow = 2;               // half width of the windows in which images are compared [px]
constexpr float kAgreement = 1;          // of forward and backward flow [px of the level]
const std::vector<int> kReaches = {4, 10};  // over which flow is exchanged [px]

/// Windows that mismatch by more are suspect.
float mismatchLimit(const Level& level, const FlowPlanes& flow, int threads) {
  return std::clamp(4 * typicalMismatch(level, flow, kWindow, threads), 0.02f, 0.12f);
}

struct Both {
  FlowPlanes forward, backward;
};

/// What of the first image the second does not show (CV_8UC1).
struct Hidden {
  cv::Mat1b uncovered;  ///< non-zero where no pixel of the second image comes from
  cv::Mat1b visible;    ///< 1 where a pixel has a match that looks like it
};

Level swapped(const Level& level) { return {level.second, level.first, level.second_valid, level.first_valid}; }

/// The interpolation's needs turned into the level's masks.
Level interpolableLevel(const Level& level) {
  return {level.first, level.second, level.first_valid, interpolable(level.second_valid)};
}

}  // namespace

Estimate estimateFlow(const Level& images, const FlowSettings& settings, int threads) {
  std::vector<Level> levels = {images};
  while (std::min(levels.back().first.rows, levels.back().first.cols) >= 2 * kSearchSide || levels.size() < 2)
    levels.push_back(halve(levels.back(), threads));

  // 1. Search, then Eq. (5) on high-passed images, which brightness changes leave alone.
  CoarseSearch search;
  search.radius = std::max(2, static_cast<int>(std::ceil(settings.search_range * std::min(levels.back().first.rows,
                                                                                          levels.back().first.cols))));
  SearchResult start = searchCoarseFlow(levels.back(), search, threads);
  Both flow{std::move(start.forward), std::move(start.backward)};
  LevelEffort effort;
  effort.energy.alpha = static_cast<float>(settings.alpha);
  effort.energy.epsilon_data = effort.energy.epsilon_smooth = static_cast<float>(settings.epsilon);
  effort.warps = settings.outer_iterations;
  effort.fixed_points = settings.inner_iterations;
  effort.sweeps = settings.solver_iterations;
  const int last = static_cast<int>(levels.size()) - 1;
  int l = last;
  for (;; --l) {
    const Level& level = levels[static_cast<std::size_t>(l)];
    if (l < last)
      flow = {doubled(flow.forward, level.first.size(), threads), doubled(flow.backward, level.first.size(), threads)};
    const Level texture = highPass(level);
    const Level forward = interpolableLevel(texture), backward = interpolableLevel(swapped(texture));
    if (l == std::min(last, kPolishLevel)) {
      const Level& finer = levels[static_cast<std::size_t>(l - 1)];
      Both patches{inverseSearch(finer, level.first.size()), inverseSearch(swapped(finer), level.first.size())};
      adoptWhereBetter(forward, flow.forward, patches.forward, threads);
      adoptWhereBetter(backward, flow.backward, patches.backward, threads);
      flow = std::move(patches);
    }
    const float clear = mismatchLimit(forward, flow.forward, threads);
    exchangeFlow(forward, kReaches, kWindow, clear, {}, flow.forward, threads);
    exchangeFlow(backward, kReaches, kWindow, clear, {}, flow.backward, threads);
    refine(forward, {1, 1, 1, 0}, effort, flow.forward, threads);
    refine(backward, {1, 1, 1, 0}, effort, flow.backward, threads);
    if (l <= kPolishLevel) break;
  }

  // 2. Brightness: from here on colours are compared as they are.
  const auto brightnessAt = [&](int at, const cv::Mat1b& visible) {
    return BrightnessMap::fit(levels[static_cast<std::size_t>(at)], flow.forward, visible, threads);
  };
  BrightnessMap brightness = brightnessAt(l, coveredBy(flow.backward));

  const int start_level = l;
  // 3. Second-order polish from coarse to fine; at each level first the boundaries and what is hidden.
  PolishEffort polishing;
  Hidden hidden;
  PolishedFlow polished;
  Level level;
  float mismatch = 0;
  for (; l >= 0; --l) {
    level = levels[static_cast<std::size_t>(l)];
    if (brightness.significant()) level.first = brightness.apply(level.first, threads);
    level = interpolableLevel(level);
    const cv::Size size = level.first.size();
    if (flow.forward.u.size() != size) flow.forward = doubled(flow.forward, size, threads);
    if (l > 0 || last == 0) mismatch = mismatchLimit(level, flow.forward, threads);
    if (l > 0 || last == 0) {
      if (flow.backward.u.size() != size) flow.backward = doubled(flow.backward, size, threads);
      const Level backward{level.second, level.first, level.second_valid, interpolable(level.first_valid)};
      exchangeFlow(backward, kReaches, kWindow, mismatch, {}, flow.backward, threads);
      const cv::Mat1b trusted = matched(backward, flow.backward, kWindow, 2 * mismatch, threads) |
                                consistent(flow.backward, flow.forward, kAgreement, threads);
      hidden.uncovered = coveredBy(flow.backward, trusted) == 0;
    } else {
      cv::resize(hidden.uncovered, hidden.uncovered, size, 0, 0, cv::INTER_NEAREST);
    }
    if (l > 0) exchangeFlow(level, kReaches, kWindow, mismatch, hidden.uncovered, flow.forward, threads);
    hidden.visible = matched(level, flow.forward, kWindow, 2 * mismatch, threads);
    if (l > 0) hidden.visible |= consistent(flow.forward, flow.backward, kAgreement, threads);
    // Specks are noise, not occlusion.
    cv::morphologyEx(hidden.visible, hidden.visible, cv::MORPH_CLOSE, cv::Mat::ones(7, 7, CV_8U));
    hidden.visible &= (hidden.uncovered == 0);
    if (!level.first_valid.empty()) hidden.visible &= level.first_valid;
    cv::erode(hidden.visible, hidden.visible, cv::Mat::ones(3, 3, CV_8U));
    if (l > 0) continueFlow(level.first, hidden.visible, flow.forward, threads);

    const ImagePair pair{level.first, splineCoefficients(level.second, threads), level.first_valid, level.second_valid};
    const cv::Vec4f weights = noiseWeights(pair, flow.forward, hidden.visible);
    polishing.linearisations = l > 0 ? settings.coarse_polish_iterations : settings.full_polish_iterations;
    polishing.solver_iterations = l > 0 ? 60 : 50;
    // In pixels of the level and over its wider spacing, a bend of the same tissue is twice as large per level.
    polishing.curvature = static_cast<float>(settings.curvature * (1 << l));
    polishing.stiff_linearisations = l == start_level ? kStiffLinearisations : 0;
    polished = polish(pair, weights, hidden.visible, flow.forward, polishing, threads);
    flow.forward = evaluate(polished, flow.forward, threads);
    if (l > 0 && brightness.significant()) brightness = brightnessAt(l, hidden.visible);
  }
  cv::Mat1b settled;
  cv::resize(polished.regular, settled, cv::Size(), SplineGrid::kSpacing, SplineGrid::kSpacing, cv::INTER_NEAREST);
  settled = settled(cv::Rect(cv::Point(), level.first.size())) | (hidden.uncovered != 0);
  exchangeFlow(level, {6, 12}, 1, mismatch, settled, flow.forward, threads);

  Estimate estimate;
  estimate.confidence = predictConfidence(level, flow.forward, hidden.visible, polished, mismatch, threads);
  estimate.flow = std::move(flow.forward);
  return estimate;
}

}  // namespace cortshift_flow
