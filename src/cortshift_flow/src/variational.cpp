#include "variational.hpp"

#include <algorithm>
#include <vector>

#include "prepare.hpp"

namespace cortshift_flow {
namespace {

constexpr int kCoarsestSide = 12;      // of the coarsest level's shorter side [px]
constexpr double kCoarseEffort = 2e6;  // pixels and outer iterations that any level may use: coarse levels are cheap
constexpr int kMostOuterIterations = 30;

}  // namespace

FlowPlanes minimiseCoarseToFine(const Level& images, const FlowSettings& settings, int threads) {
  std::vector<Level> levels = {images};
  while (std::min(levels.back().first.rows, levels.back().first.cols) >= 2 * kCoarsestSide)
    levels.push_back(halve(levels.back(), threads));

  LevelEffort effort;
  effort.energy.alpha = static_cast<float>(settings.alpha);
  effort.energy.epsilon_data = effort.energy.epsilon_smooth = static_cast<float>(settings.epsilon);
  effort.fixed_points = settings.inner_iterations;
  effort.sweeps = settings.solver_iterations;
  FlowPlanes flow;
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    const cv::Size size = level->first.size();
    flow = flow.u.empty() ? FlowPlanes{Plane(size), Plane(size)} : doubled(flow, size, threads);
    const int affordable = static_cast<int>(kCoarseEffort / size.area());
    effort.warps = std::max(settings.outer_iterations, std::min(kMostOuterIterations, affordable));
    Level masked = *level;
    masked.second_valid = interpolable(level->second_valid);
    refine(masked, {1, 1, 1, 0}, effort, flow, threads);
  }
  return flow;
}

}  // namespace cortshift_flow
