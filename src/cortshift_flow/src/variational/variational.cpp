#include "variational/variational.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "images/prepare.hpp"

namespace cortshift_flow {
namespace {

constexpr int kCoarsestSide = 12;      // of the coarsest level's shorter side [px]
constexpr double kCoarseEffort = 2e6;  // pixels times outer iterations at each level: more iterations at coarse ones
constexpr int kMostOuterIterations = 30;

// Eq. (3) with the norm of I(p) as the mean over the channels (Liu 2009 averages them too): a grey image then means
// the same as its copy in three channels, and alpha keeps its meaning for both.
const cv::Vec4f kChannelMean(1 / 3.f, 1 / 3.f, 1 / 3.f, 0);

/// "A coarse, smoothed image set" (section 2.4): rounding to 8 bits is noise, and a little smoothing averages it out.
cv::Mat4f smoothed(const cv::Mat4f& image, double sigma) {
  if (sigma <= 0) return image;
  cv::Mat result;
  cv::GaussianBlur(image, result, cv::Size(), sigma, sigma, cv::BORDER_REFLECT_101);
  return result;
}

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
    const Level smooth{smoothed(level->first, settings.presmoothing), smoothed(level->second, settings.presmoothing),
                       level->first_valid, level->second_valid};
    refine(interpolableLevel(smooth), kChannelMean, effort, flow, threads);
  }
  return flow;
}

}  // namespace cortshift_flow
