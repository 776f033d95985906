#include "estimator.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "coarse_search.hpp"
#include "confidence.hpp"
#include "exchange.hpp"
#include "high_pass.hpp"
#include "noise.hpp"
#include "occlusion.hpp"
#include "photometric.hpp"
#include "polish.hpp"
#include "prepare.hpp"

namespace cortshift_flow {
namespace {

constexpr int kSearchSide = 96;  // the search runs at the first level whose shorter side is below twice this [px]
constexpr int kPolishLevel = 1;  // from this level down the polish takes over from Eq. (5)

struct Both {
  FlowPlanes forward, backward;
};

Level swapped(const Level& level) {
  return {level.second, level.first, level.second_valid, level.first_valid};
}

/// The interpolation's needs turned into the level's masks.
Level interpolableLevel(const Level& level) {
  return {level.first, level.second, level.first_valid, interpolable(level.second_valid)};
}

struct Stopwatch {
  const bool on = std::getenv("FLOW_TIMES") != nullptr;
  std::chrono::steady_clock::time_point last = std::chrono::steady_clock::now();
  void lap(const char* what) {
    const auto now = std::chrono::steady_clock::now();
    if (on) std::fprintf(stderr, "  %-22s %6.1f ms\n", what, 1e3 * std::chrono::duration<double>(now - last).count());
    last = std::chrono::steady_clock::now();
  }
};

}  // namespace

Estimate estimateFlow(const Level& images, const FlowSettings& settings, int threads) {
  Stopwatch watch;
  std::vector<Level> levels = {images};
  while (std::min(levels.back().first.rows, levels.back().first.cols) >= 2 * kSearchSide || levels.size() < 2)
    levels.push_back(halve(levels.back(), threads));
  watch.lap("pyramid");

  // 1. Search, then Eq. (5) on high-passed images, which brightness changes leave alone.
  CoarseSearch search;
  search.radius = std::max(
      2, static_cast<int>(std::ceil(settings.search_range * std::min(levels.back().first.rows, levels.back().first.cols))));
  SearchResult start = searchCoarseFlow(levels.back(), search, threads);
  Both flow{std::move(start.forward), std::move(start.backward)};
  watch.lap("search");
  LevelEffort effort;
  effort.energy.alpha = static_cast<float>(settings.alpha);
  effort.energy.epsilon_data = effort.energy.epsilon_smooth = static_cast<float>(settings.epsilon);
  effort.warps = settings.outer_iterations;
  effort.fixed_points = settings.inner_iterations;
  effort.sweeps = settings.solver_iterations;
  const int last = static_cast<int>(levels.size()) - 1;
  for (int l = last; l > kPolishLevel || l == last; --l) {
    const Level& level = levels[static_cast<std::size_t>(l)];
    if (l < last)
      flow = {doubled(flow.forward, level.first.size(), threads), doubled(flow.backward, level.first.size(), threads)};
    const Level texture = interpolableLevel(highPass(level));
    const Level backward = interpolableLevel(swapped(highPass(level)));
    watch.lap("high pass");
    for (int k = 0; k < 2; ++k) {
      exchangeFlow(texture, {2, 5, 10}, 2, 0.02f, flow.forward, threads);
      exchangeFlow(backward, {2, 5, 10}, 2, 0.02f, flow.backward, threads);
    }
    watch.lap("exchange");
    refine(texture, {1, 1, 1, 0}, effort, flow.forward, threads);
    refine(backward, {1, 1, 1, 0}, effort, flow.backward, threads);
    watch.lap("refine");
    if (l == 0) break;
  }

  // 2. Brightness.
  const int coarse = std::max(kPolishLevel + 1, 0) <= last ? kPolishLevel + 1 : last;
  const Level& fitted = levels[static_cast<std::size_t>(coarse)];
  const BrightnessMap brightness =
      BrightnessMap::fit(fitted, flow.forward, coveredBy(flow.backward), threads);
  for (int l = 0; l <= kPolishLevel; ++l)
    levels[static_cast<std::size_t>(l)].first = brightness.apply(levels[static_cast<std::size_t>(l)].first, threads);
  watch.lap("brightness");

  // 3. Boundaries and what is hidden, at half resolution.
  const Level half = interpolableLevel(levels[kPolishLevel]);
  const Level half_backward = interpolableLevel(swapped(levels[kPolishLevel]));
  if (coarse != kPolishLevel)
    flow = {doubled(flow.forward, half.first.size(), threads), doubled(flow.backward, half.first.size(), threads)};
  float mismatch = std::clamp(3 * typicalMismatch(half, flow.forward, 2, threads), 0.012f, 0.05f);
  watch.lap("typical mismatch");
  for (int k = 0; k < 2; ++k) {
    exchangeFlow(half, {3, 8, 16}, 2, mismatch, flow.forward, threads);
    exchangeFlow(half_backward, {3, 8, 16}, 2, mismatch, flow.backward, threads);
  }
  watch.lap("exchange half");
  cv::Mat1b visible = coveredBy(flow.backward) & matched(half, flow.forward, 2, 2 * mismatch, threads);
  if (!half.first_valid.empty()) visible &= half.first_valid;
  cv::erode(visible, visible, cv::Mat::ones(3, 3, CV_8U));
  continueFlow(half.first, visible, flow.forward, threads);
  watch.lap("continue");

  // 4. Polish.
  PolishEffort polishing;
  polishing.curvature = static_cast<float>(settings.curvature);
  polishing.linearisations = settings.half_polish_iterations;
  const ImagePair half_pair{half.first, splineCoefficients(half.second, threads), half.first_valid, half.second_valid};
  cv::Vec4f weights = noiseWeights(half_pair, flow.forward, visible);
  PolishedFlow polished = polish(half_pair, weights, visible, flow.forward, polishing, threads);
  flow.forward = evaluate(polished, flow.forward, threads);
  watch.lap("polish half");

  const Level full = interpolableLevel(levels[0]);
  flow.forward = doubled(flow.forward, full.first.size(), threads);
  exchangeFlow(full, {4, 10}, 2, mismatch, flow.forward, threads);
  watch.lap("exchange full");
  cv::Mat1b visible_full;
  cv::resize(visible, visible_full, full.first.size(), 0, 0, cv::INTER_NEAREST);
  if (!full.first_valid.empty()) visible_full &= full.first_valid;
  const ImagePair pair{full.first, splineCoefficients(full.second, threads), full.first_valid, full.second_valid};
  watch.lap("spline");
  weights = noiseWeights(pair, flow.forward, visible_full);
  watch.lap("noise");
  polishing.linearisations = settings.full_polish_iterations;
  polished = polish(pair, weights, visible_full, flow.forward, polishing, threads);
  watch.lap("polish full");

  Estimate estimate;
  estimate.flow = evaluate(polished, flow.forward, threads);
  estimate.confidence = predictConfidence(full, estimate.flow, flow.backward, visible_full, polished, mismatch, threads);
  watch.lap("confidence");
  return estimate;
}

}  // namespace cortshift_flow
