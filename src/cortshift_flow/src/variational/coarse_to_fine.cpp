#include "variational/coarse_to_fine.hpp"

#include <algorithm>

#include "parallel.hpp"

namespace cortshift_flow {
namespace {

CORTSHIFT_VECTORISED
void doubleRow(const float* above, const float* below, float weight_below, float* blended, float* out, int coarse_width,
               int width) {
#pragma GCC ivdep
  for (int x = 0; x < coarse_width; ++x) blended[x] = 2 * (above[x] + weight_below * (below[x] - above[x]));
  blended[coarse_width] = blended[coarse_width - 1];
#pragma GCC ivdep
  for (int x = 0; x < width; ++x) out[x] = 0.5f * (blended[x / 2] + blended[(x + 1) / 2]);
}

void doubleInto(const Plane& coarse, Plane& fine, int threads) {
  forRows(fine.height(), threads, [&](int begin, int end) {
    std::vector<float> blended(static_cast<std::size_t>(coarse.width() + 1));
    for (int y = begin; y < end; ++y) {
      const int above = std::min(y / 2, coarse.height() - 1), below = std::min((y + 1) / 2, coarse.height() - 1);
      doubleRow(coarse.row(above), coarse.row(below), 0.5f, blended.data(), fine.row(y), coarse.width(), fine.width());
    }
  });
}

}  // namespace

FlowPlanes doubled(const FlowPlanes& coarse, cv::Size size, int threads) {
  FlowPlanes fine{Plane(size), Plane(size)};
  doubleInto(coarse.u, fine.u, threads);
  doubleInto(coarse.v, fine.v, threads);
  return fine;
}

void refine(const Level& level, const cv::Vec4f& channel_weights, const LevelEffort& effort, FlowPlanes& flow,
            int threads) {
  const ImagePair images{level.first, splineCoefficients(level.second, threads), level.first_valid, level.second_valid};
  MotionTensor tensor;
  LinkedSystem system;
  for (int warp = 0; warp < effort.warps; ++warp) {
    linearise(images, flow.u, flow.v, channel_weights, tensor, threads);
    const FlowPlanes start = flow;
    minimise(tensor, start.u, start.v, {}, effort.energy, effort.fixed_points, effort.sweeps, system, flow.u, flow.v,
             threads);
  }
}

}  // namespace cortshift_flow
