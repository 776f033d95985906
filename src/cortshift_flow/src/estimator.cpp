#include "estimator.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "images/high_pass.hpp"
#include "images/noise.hpp"
#include "images/photometric.hpp"
#include "images/prepare.hpp"
#include "polish/piecewise.hpp"
#include "polish/polish.hpp"
#include "polish/spline_grid.hpp"
#include "start/exchange.hpp"
#include "start/rough_flow.hpp"
#include "trust/confidence.hpp"
#include "trust/evidence.hpp"
#include "trust/flow_steps.hpp"
#include "trust/judgement.hpp"
#include "trust/mismatch.hpp"
#include "trust/occlusion.hpp"

namespace cortshift_flow {
namespace {

constexpr int kPolishLevel = 2;          // from this level on the polish takes over from Eq. (5)
constexpr int kStiffLinearisations = 2;  // of the first polish, whose start is too rough to show curvature
constexpr int kConjugateGradients = 60;  // per linearisation
constexpr float kAgreement = 1;          // of forward and backward flow [px of the level]
// Share of pixels of which the smooth fit itself says that they are unsure beyond which it is no model of the scene:
// seen on photographs of objects at many depths (BENCHMARK.md, aloe and motorcycle).
constexpr float kNoModel = 0.33f;
constexpr float kUnsure = 0.25f;    // an error beyond which a flow counts as unsure [px of the level]
constexpr float kAdmitted = 0.99f;  // what a fit expects of itself where it knows that it is wrong [px]

/// A polish, and what it compared.
struct Fit {
  ImagePair images;
  cv::Vec4f channel_weights;
  PolishedFlow polished;
};

/// One polish at a level, with the noise learned from what `visible` shows.
Fit polishAt(const Level& level, int l, const cv::Mat1b& visible, const FlowPlanes& start, int linearisations,
             int stiff, const FlowSettings& settings, int threads) {
  Fit fit{{level.first, splineCoefficients(level.second, threads), level.first_valid, level.second_valid}, {}, {}};
  PolishEffort effort;
  effort.linearisations = linearisations;
  effort.stiff_linearisations = stiff;
  effort.solver_iterations = kConjugateGradients;
  // Each coarser level has pixels and node distances twice as large: the same bend of the tissue then has twice the
  // second difference.
  effort.curvature = static_cast<float>(settings.curvature * (1 << l));
  fit.channel_weights = noiseWeights(fit.images, start, visible);
  fit.polished = polish(fit.images, fit.channel_weights, visible, start, effort, threads);
  return fit;
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

/// Another model's flow, near the given one: Eq. (5) at half the resolution, whose smoothness is of the first order.
FlowPlanes secondOpinion(const Level& coarser, const FlowPlanes& flow, const FlowSettings& settings, int threads) {
  const Level half = interpolableLevel(highPass(coarser));
  FlowPlanes coarse{Plane(half.first.size()), Plane(half.first.size())};
  for (const auto& [from, to] : {std::pair(&flow.u, &coarse.u), std::pair(&flow.v, &coarse.v)})
    for (int y = 0; y < to->height(); ++y)
      for (int x = 0; x < to->width(); ++x) to->row(y)[x] = 0.5f * from->row(2 * y)[2 * x];
  refine(half, {1, 1, 1, 0}, roughEffort(settings), coarse, threads);
  return doubled(coarse, flow.u.size(), threads);
}

/// Judges flows by the images of one fit: the predicted error per pixel [px of the level].
struct Judge {
  const Fit& fit;
  int threads;
  std::vector<Told>* told;

  /// What differs from flow to flow: see Judged.
  struct Candidate {
    const FlowPlanes &flow, &backward, &other;
    const cv::Mat1b& sound;
    const cv::Mat1f& fit_error;
  };

  /// @param evidence  if given, what it is judged by
  cv::Mat1f operator()(const Candidate& candidate, FitKind kind, cv::Mat* evidence = nullptr) const {
    const cv::Mat gathered = gatherEvidence({fit.images, fit.channel_weights, candidate.flow, candidate.backward,
                                             candidate.other, candidate.sound, candidate.fit_error},
                                            threads);
    if (told) told->push_back({kind, candidate.flow, gathered});
    if (evidence) *evidence = gathered;
    return judgedError(gathered, kind, candidate.fit_error, threads);
  }
};

/// Where the other flow is judged better: by regions, because single pixels are noise.
cv::Mat1b wherePreferred(const cv::Mat1f& other_error, const cv::Mat1f& error) {
  // Chosen on the sets "fit" and "choose" of benchmark/trust_pairs.py, where the mean error hardly depends on them.
  constexpr double kRegion = 16;    // standard deviation over which the two are compared [px]
  constexpr double kAdvance = 0.5;  // of the other one, in logarithms: the smooth fit's judgement is the rosier one
  constexpr double kFar = 4;        // larger errors count as this [px]
  cv::Mat1f present, offered, gain;
  cv::log(cv::min(error, kFar), present);
  cv::log(cv::min(other_error, kFar), offered);
  cv::GaussianBlur(present - offered, gain, {}, kRegion);
  return gain > -kAdvance;
}

void adopt(const FlowPlanes& other, const cv::Mat1b& where, FlowPlanes& flow) {
  for (int y = 0; y < where.rows; ++y)
    for (int x = 0; x < where.cols; ++x)
      if (where(y, x)) {
        flow.u.row(y)[x] = other.u.row(y)[x];
        flow.v.row(y)[x] = other.v.row(y)[x];
      }
}

/// The judgement of the smooth fit beside its own word: both must be satisfied, since each catches what the other
/// misses (noise that bends the flow; a boundary; an extrapolation out of the image). Where something covers the tissue
/// both are guesses, and their mean is right more often than the greater. Chosen on the set "choose" of
/// benchmark/trust_pairs.py.
/// @param occluded  CV_8UC1, not 0 where the second image shows other tissue
cv::Mat1f smoothError(const cv::Mat1f& judged, const cv::Mat1f& fit_error, const cv::Mat1b& occluded) {
  cv::Mat1f error(judged.size());
  for (int y = 0; y < error.rows; ++y)
    for (int x = 0; x < error.cols; ++x) {
      const float of_images = judged(y, x), own = fit_error(y, x);
      error(y, x) = occluded(y, x) && own < kAdmitted ? std::sqrt(of_images * own) : std::max(of_images, own);
    }
  return error;
}

/// The judgement of the piecewise fit, which is believed where it says itself that its two directions disagree.
cv::Mat1f piecewiseError(const cv::Mat1f& judged, const cv::Mat1f& gap) {
  cv::Mat1f error = judged.clone();
  cv::Mat1f(cv::max(judged, gap)).copyTo(error, gap >= kAdmitted);
  return error;
}

}  // namespace

Estimate estimateFlow(const Level& images, const FlowSettings& settings, int threads, std::vector<Told>* told) {
  const std::vector<Level> levels = searchPyramid(images, threads);
  const int start = std::min(static_cast<int>(levels.size()) - 1, kPolishLevel);
  FlowBothWays flow = roughFlow(levels, start, settings, threads);

  // Make both images equally bright: from here on colours are compared directly.
  BrightnessMap brightness =
      BrightnessMap::fit(levels[static_cast<std::size_t>(start)], flow.forward, coveredBy(flow.backward), threads);

  // Second-order polish from coarse to fine; at each level but the finest first the boundaries and what is hidden.
  Level level;
  cv::Mat1b uncovered, occluded, visible;
  Fit fit;
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
        flow.backward =
            evaluate(polishAt(backward, l, seen, flow.backward, 4, kStiffLinearisations, settings, threads).polished,
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
    fit = polishAt(level, l, visible, flow.forward,
                   finest ? settings.full_polish_iterations : settings.coarse_polish_iterations,
                   l == start ? kStiffLinearisations : 0, settings, threads);
    flow.forward = evaluate(fit.polished, flow.forward, threads);
    if (l > 0 && brightness.significant())
      brightness = BrightnessMap::fit(levels[static_cast<std::size_t>(l)], flow.forward, visible, threads);
  }
  cv::Mat1b regular;
  cv::resize(fit.polished.regular, regular, cv::Size(), SplineGrid::kSpacing, SplineGrid::kSpacing, cv::INTER_NEAREST);
  regular = regular(cv::Rect(cv::Point(), level.first.size())).clone();
  exchangeFlow(level, {6, 12}, 1, scale.suspect, regular | (uncovered != 0), flow.forward, threads);

  Estimate estimate;
  cv::Mat1f error = predictError(level, flow.forward, visible, fit.polished,
                                 static_cast<float>(settings.curvature * (1 << finest_level)), scale.suspect, threads);
  if (settings.judge) {
    const Judge judge{fit, threads, told};
    const cv::Mat1b sound = regular & visible;
    const auto next = static_cast<std::size_t>(finest_level) + 1;
    const FlowPlanes second =
        secondOpinion(next < levels.size() ? levels[next] : halve(level, threads), flow.forward, settings, threads);
    cv::Mat evidence;
    cv::Mat1f judged = judge({flow.forward, flow.backward, second, sound, error}, FitKind::kSmooth, &evidence);
    const bool no_model = shareUnsure(error, flow.forward) > kNoModel;
    // A piecewise fit only at full resolution: settings that stop before it are chosen for their speed.
    if (finest_level == 0 && settings.most_unsure < 1 &&
        (no_model || shareContradicted(evidence, judged) > static_cast<float>(settings.most_unsure) || told)) {
      const PiecewiseFlow other = piecewiseFlow(levels, start, finest_level, settings, threads);
      const cv::Mat1f piecewise =
          judge({other.flow.forward, other.flow.backward, flow.forward, other.agree, other.error}, FitKind::kPiecewise);
      judged = judge({flow.forward, other.flow.backward, other.flow.forward, sound, error}, FitKind::kSmoothOfTwo);
      const cv::Mat1b better = no_model ? cv::Mat1b(error.size(), uchar{1}) : wherePreferred(piecewise, judged);
      adopt(other.flow.forward, better, flow.forward);
      error = smoothError(judged, error, occluded);
      // Beside a fit that is no model of the scene the two do not check each other: the piecewise one's own word
      // counts.
      cv::Mat1f(no_model ? cv::Mat1f(cv::max(piecewise, other.error)) : piecewiseError(piecewise, other.error))
          .copyTo(error, better);
    } else {
      error = smoothError(judged, error, occluded);
    }
    cv::max(error, cv::Mat(errorBesideSteps(flow.forward)), error);
  }
  estimate.confidence = confidenceFromError(error, finest_level, images.first.size(), threads);
  if (!images.first_valid.empty()) estimate.confidence.setTo(0, images.first_valid == 0);
  for (int l = finest_level - 1; l >= 0; --l)
    flow.forward = doubled(flow.forward, levels[static_cast<std::size_t>(l)].first.size(), threads);
  estimate.flow = std::move(flow.forward);
  return estimate;
}

}  // namespace cortshift_flow
