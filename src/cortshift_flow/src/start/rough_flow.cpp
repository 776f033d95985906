#include "start/rough_flow.hpp"

#include <algorithm>
#include <cmath>

#include "images/high_pass.hpp"
#include "images/prepare.hpp"
#include "start/coarse_search.hpp"
#include "start/exchange.hpp"
#include "start/inverse_search.hpp"
#include "trust/mismatch.hpp"
#include "trust/occlusion.hpp"

namespace cortshift_flow {
namespace {

constexpr float kPatchAgreement = 1.5f;  // of the patches' flow forward and backward [px of the level]
constexpr int kSearchSide = 48;  // the search runs at the first level whose shorter side is below twice this [px]

int searchRadius(const Level& level, double range) {
  return std::max(2, static_cast<int>(std::ceil(range * std::min(level.first.rows, level.first.cols))));
}

/// Takes the flow of the DIS patches where it fits better: they follow motions that the windows of the search lose.
void consultPatches(const Level& finer, const Level& forward, const Level& backward, FlowBothWays& flow, int threads) {
  InverseSearch patches = inverseSearch(finer, forward.first.size());
  const cv::Mat1b agree_forward = consistent(patches.forward, patches.backward, kPatchAgreement, threads);
  const cv::Mat1b agree_backward = consistent(patches.backward, patches.forward, kPatchAgreement, threads);
  adoptWhereBetter(forward, patches.forward, agree_forward, flow.forward, threads);
  adoptWhereBetter(backward, patches.backward, agree_backward, flow.backward, threads);
}

}  // namespace

const std::vector<int>& exchangeReaches() {
  static const std::vector<int> reaches = {4, 10};
  return reaches;
}

LevelEffort roughEffort(const FlowSettings& settings) {
  LevelEffort effort;
  effort.energy.alpha = static_cast<float>(settings.alpha);
  effort.energy.epsilon_data = effort.energy.epsilon_smooth = static_cast<float>(settings.epsilon);
  effort.warps = settings.outer_iterations;
  effort.fixed_points = settings.inner_iterations;
  effort.sweeps = settings.solver_iterations;
  return effort;
}

std::vector<Level> searchPyramid(const Level& images, int threads) {
  std::vector<Level> levels = {images};
  while (std::min(levels.back().first.rows, levels.back().first.cols) >= 2 * kSearchSide || levels.size() < 2)
    levels.push_back(halve(levels.back(), threads));
  return levels;
}

FlowBothWays roughFlow(const std::vector<Level>& levels, int finest, const FlowSettings& settings, int threads) {
  SearchResult found = searchCoarseFlow(levels.back(), searchRadius(levels.back(), settings.search_range), threads);
  FlowBothWays flow{std::move(found.forward), std::move(found.backward)};
  const LevelEffort effort = roughEffort(settings);
  for (int l = static_cast<int>(levels.size()) - 1; l >= finest; --l) {
    const Level texture = highPass(levels[static_cast<std::size_t>(l)]);
    const Level forward = interpolableLevel(texture), backward = interpolableLevel(swapped(texture));
    const cv::Size size = texture.first.size();
    if (flow.forward.u.size() != size)
      flow = {doubled(flow.forward, size, threads), doubled(flow.backward, size, threads)};
    if (l == finest && l > 0) consultPatches(levels[static_cast<std::size_t>(l - 1)], forward, backward, flow, threads);
    if (l > finest) {  // not at the finest: the patches were used before it, and the polish begins with an exchange
      const float suspect = mismatchScale(forward, flow.forward, threads).suspect;
      exchangeFlow(forward, exchangeReaches(), kMatchWindow, suspect, {}, flow.forward, threads);
      exchangeFlow(backward, exchangeReaches(), kMatchWindow, suspect, {}, flow.backward, threads);
    }
    refine(forward, {1, 1, 1, 0}, effort, flow.forward, threads);
    refine(backward, {1, 1, 1, 0}, effort, flow.backward, threads);
  }
  return flow;
}

}  // namespace cortshift_flow
