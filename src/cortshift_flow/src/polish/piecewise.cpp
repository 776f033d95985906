#include "polish/piecewise.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "images/high_pass.hpp"
#include "images/prepare.hpp"
#include "parallel.hpp"
#include "start/exchange.hpp"
#include "start/rough_flow.hpp"
#include "trust/mismatch.hpp"
#include "trust/occlusion.hpp"
#include "variational/variational.hpp"

namespace cortshift_flow {
namespace {

constexpr int kLinearisations = 8, kFullLinearisations = 6;  // per level, and at full resolution
constexpr int kMedian = 5;                                   // side of the median filter [px]
constexpr float kAgreement = 1;                              // of forward and backward flow [px of the level]
constexpr float kColourKept = 0.2f;     // share of slow variations that is kept: smooth objects show nothing else
constexpr float kOrdinaryError = 0.2f;  // where both directions agree [px]
constexpr float kHiddenError = 4;       // where they do not [px]

void medianFilter(FlowPlanes& flow) {
  for (Plane* plane : {&flow.u, &flow.v}) {
    cv::Mat1f values(plane->size()), filtered;
    for (int y = 0; y < values.rows; ++y) std::copy_n(plane->row(y), values.cols, values.ptr<float>(y));
    cv::medianBlur(values, filtered, kMedian);
    for (int y = 0; y < values.rows; ++y) std::copy_n(filtered.ptr<float>(y), values.cols, plane->row(y));
  }
}

void improve(const Level& level, int linearisations, FlowPlanes& flow, int threads) {
  LevelEffort effort;
  effort.warps = 1;
  effort.fixed_points = 3;
  effort.sweeps = 15;
  for (int i = 0; i < linearisations; ++i) {
    refine(level, {1, 1, 1, 0}, effort, flow, threads);
    medianFilter(flow);
  }
}

/// Takes the paper's model where it fits the colours better: it follows smooth objects that have no texture to match.
void consultColours(const Level& level, FlowBothWays& flow, int threads) {
  const FlowSettings model = FlowSettings::preset("ji2014");
  const cv::Mat1b everywhere(level.first.size(), 1);
  const Level forward = interpolableLevel(level), backward = interpolableLevel(swapped(level));
  adoptWhereBetter(forward, minimiseCoarseToFine(level, model, threads), everywhere, flow.forward, threads);
  adoptWhereBetter(backward, minimiseCoarseToFine(swapped(level), model, threads), everywhere, flow.backward, threads);
}

/// Distance from a pixel to where following the flow and then the opposite flow ends; infinite where a mask excludes
/// it.
cv::Mat1f gapError(const FlowBothWays& flow, const cv::Mat1b& agree, const cv::Mat1b& valid) {
  cv::Mat1f error(agree.size());
  for (int y = 0; y < error.rows; ++y)
    for (int x = 0; x < error.cols; ++x) {
      error(y, x) = agree(y, x) ? kOrdinaryError : kHiddenError;
      if (!valid.empty() && !valid(y, x)) error(y, x) = std::numeric_limits<float>::infinity();
      if (!agree(y, x)) continue;
      const float u = flow.forward.u.row(y)[x], v = flow.forward.v.row(y)[x];
      const int tx = static_cast<int>(std::lround(static_cast<float>(x) + u)),
                ty = static_cast<int>(std::lround(static_cast<float>(y) + v));
      error(y, x) += std::hypot(u + flow.backward.u.row(ty)[tx], v + flow.backward.v.row(ty)[tx]);
    }
  return error;
}

}  // namespace

PiecewiseFlow piecewiseFlow(const std::vector<Level>& levels, int start, int finest, const FlowSettings& settings,
                            int threads) {
  FlowBothWays flow = roughFlow(levels, start, settings, threads);
  consultColours(levels[static_cast<std::size_t>(start)], flow, threads);
  cv::Mat1b agree;
  for (int l = start; l >= finest; --l) {
    const Level& level = levels[static_cast<std::size_t>(l)];
    const Level texture = highPass(level, kColourKept);
    const Level forward = interpolableLevel(texture), backward = interpolableLevel(swapped(texture));
    const cv::Size size = level.first.size();
    const int linearisations = l > 0 ? kLinearisations : kFullLinearisations;
    if (flow.forward.u.size() != size)
      flow = {doubled(flow.forward, size, threads), doubled(flow.backward, size, threads)};
    const float suspect = mismatchScale(forward, flow.forward, threads).suspect;
    exchangeFlow(forward, exchangeReaches(), kMatchWindow, suspect, {}, flow.forward, threads);
    exchangeFlow(backward, exchangeReaches(), kMatchWindow, suspect, {}, flow.backward, threads);
    improve(forward, linearisations, flow.forward, threads);
    improve(backward, linearisations, flow.backward, threads);
    agree = consistent(flow.forward, flow.backward, kAgreement, threads);
    const cv::Mat1b agree_back = consistent(flow.backward, flow.forward, kAgreement, threads);
    continueFlow(level.first, agree, Continue::kResting, flow.forward, threads);
    continueFlow(level.second, agree_back, Continue::kResting, flow.backward, threads);
  }
  agree &= consistent(flow.forward, flow.backward, kAgreement, threads);
  const cv::Mat1f error = gapError(flow, agree, levels[static_cast<std::size_t>(finest)].first_valid);
  return {std::move(flow), agree, error};
}

}  // namespace cortshift_flow
