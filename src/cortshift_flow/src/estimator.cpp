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
#include "spline_grid.hpp"

namespace cortshift_flow {
namespace {

constexpr int kSearchSide = 96;  // the search runs at the first level whose shorter side is below twice this [px]
constexpr int kPolishLevel = 2;  // from this level on the polish takes over from Eq. (5)

struct Both {
  FlowPlanes forward, backward;
};

/// What of the first image the second does not show (CV_8UC1).
struct Hidden {
  cv::Mat1b uncovered;  ///< non-zero where no pixel of the second image comes from
  cv::Mat1b visible;    ///< 1 where a pixel has a match that looks like it
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
  int l = last;
  for (;; --l) {
    const Level& level = levels[static_cast<std::size_t>(l)];
    if (l < last)
      flow = {doubled(flow.forward, level.first.size(), threads), doubled(flow.backward, level.first.size(), threads)};
    const Level texture = highPass(level);
    const Level forward = interpolableLevel(texture), backward = interpolableLevel(swapped(texture));
    watch.lap("high pass");
    for (int k = 0; k < 2; ++k) {
      exchangeFlow(forward, {2, 5, 10}, 2, 0.02f, {}, flow.forward, threads);
      exchangeFlow(backward, {2, 5, 10}, 2, 0.02f, {}, flow.backward, threads);
    }
    watch.lap("exchange");
    refine(forward, {1, 1, 1, 0}, effort, flow.forward, threads);
    refine(backward, {1, 1, 1, 0}, effort, flow.backward, threads);
    watch.lap("refine");
    if (l <= kPolishLevel) break;
  }

  // 2. Brightness: from here on colours are compared as they are.
  const auto brightnessAt = [&](int at, const cv::Mat1b& visible) {
    const BrightnessMap map = BrightnessMap::fit(levels[static_cast<std::size_t>(at)], flow.forward, visible, threads);
    watch.lap("brightness");
    return map;
  };
  BrightnessMap brightness = brightnessAt(l, coveredBy(flow.backward));

  // 3. Second-order polish from coarse to fine; at each level first the boundaries and what is hidden.
  PolishEffort polishing;
  polishing.curvature = static_cast<float>(settings.curvature);
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
    watch.lap("doubled");
    mismatch = std::clamp(4 * typicalMismatch(level, flow.forward, 2, threads), 0.02f, 0.12f);
    watch.lap("typical mismatch");
    if (l > 0 || last == 0) {
      if (flow.backward.u.size() != size) flow.backward = doubled(flow.backward, size, threads);
      const Level backward{level.second, level.first, level.second_valid, interpolable(level.first_valid)};
      exchangeFlow(backward, {4, 10}, 2, mismatch, {}, flow.backward, threads);
      hidden.uncovered = coveredBy(flow.backward) == 0;
    } else {
      cv::resize(hidden.uncovered, hidden.uncovered, size, 0, 0, cv::INTER_NEAREST);
    }
    watch.lap("exchange back");
    exchangeFlow(level, {4, 10}, 2, mismatch, hidden.uncovered, flow.forward, threads);
    watch.lap("exchange");
    hidden.visible = matched(level, flow.forward, 2, 2 * mismatch, threads) & (hidden.uncovered == 0);
    if (!level.first_valid.empty()) hidden.visible &= level.first_valid;
    cv::erode(hidden.visible, hidden.visible, cv::Mat::ones(3, 3, CV_8U));
    if (l > 0) continueFlow(level.first, hidden.visible, flow.forward, threads);
    watch.lap("continue");

    const ImagePair pair{level.first, splineCoefficients(level.second, threads), level.first_valid, level.second_valid};
    watch.lap("spline");
    cv::Vec4f weights = noiseWeights(pair, flow.forward, hidden.visible); if(std::getenv("FLOW_TIMES")) std::fprintf(stderr,"noise %.3f %.3f %.3f mm %.4f\n",255/sqrt(weights[0]),255/sqrt(weights[1]),255/sqrt(weights[2]),mismatch); if(std::getenv("SG")) {float w=255*255/std::atof(std::getenv("SG"))/std::atof(std::getenv("SG")); weights={w,w,w,0};}
    watch.lap("noise");
    polishing.linearisations = l > 0 ? settings.half_polish_iterations : settings.full_polish_iterations;
    {const char* n[3]={"CG0","CG1","CG2"}; const char* m[3]={"N0","N1","N2"}; int k=std::min(l,2); if (std::getenv(n[k])) polishing.solver_iterations = std::atoi(std::getenv(n[k])); if (std::getenv(m[k])) polishing.linearisations = std::atoi(std::getenv(m[k]));}
    polished = polish(pair, weights, hidden.visible, flow.forward, polishing, threads);
    flow.forward = evaluate(polished, flow.forward, threads);
    watch.lap("polish");
    if (l > 0 && brightness.significant()) brightness = brightnessAt(l, hidden.visible);
  }
  cv::Mat1b settled;
  cv::resize(polished.regular, settled, cv::Size(), SplineGrid::kSpacing, SplineGrid::kSpacing, cv::INTER_NEAREST);
  settled = settled(cv::Rect(cv::Point(), level.first.size())) | (hidden.uncovered != 0);
  exchangeFlow(level, {6, 12}, 1, mismatch, settled, flow.forward, threads);
  watch.lap("exchange");

  Estimate estimate;
  estimate.confidence =
      predictConfidence(level, flow.forward, flow.backward, hidden.visible, polished, mismatch, threads);
  estimate.flow = std::move(flow.forward);
  watch.lap("confidence");
  return estimate;
}

}  // namespace cortshift_flow
