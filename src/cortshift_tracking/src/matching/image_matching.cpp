#include "cortshift_tracking/matching/image_matching.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cortshift_flow/range.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/trust/probability.hpp"
#include "matching/flow_targets.hpp"
#include "parallel.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_flow::FlowResult;

constexpr double kSettled = 0.4;       // a vector of at least this probability is settled: others are guessed from it
constexpr double kWorthARound = 0.01;  // another first look is made while more of the overlap is not settled
constexpr double kLeastGain = 0.002;   // another look follows if the last one settled at least this part of the overlap
constexpr double kReach = 0.005;       // the next look includes tissue up to this far from settled tissue [m]
constexpr double kLastReach = 0.003;   // the same for the last look [m]
constexpr double kCoarseDetail = 3.5;  // `detail` of the first looks, relative to that of the last
constexpr double kRestSearch = 0.0015;       // largest motion that is searched after a first look [m]
constexpr double kSmoothing = 4;             // standard deviation, of a continued flow [px]
constexpr double kQuickResolution = 0.0004;  // of the looks that choose the channels [m]
constexpr double kFollowed = 0.75;  // if this part of the overlap settles with all three channels, no others are tried
constexpr double kBetter = 0.02;    // other channels are preferred if they settle this much more of the overlap

/// Both stages on a grid, as the flow sees them.
struct Pair {
  Seen first, second;
  cv::Mat first_height, second_height;  // CV_32FC1 [px], continued over holes
  double resolution = 0;                // [m]
};

/// CV_8UC1 255: vectors that are probably right.
cv::Mat settledMask(const Pair& pair, const FlowResult& result) {
  const Agreement agreement = agreementOf(pair.first, pair.second, result.flow, pair.resolution);
  return probabilityOfMatch(result.confidence, agreement, pair.resolution) >= kSettled;
}

/// CV_8UC1 255 where settled tissue is no further than `reach` [m].
cv::Mat around(const cv::Mat& settled, double reach, double resolution) {
  cv::Mat distance;
  cv::distanceTransform(settled == 0, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  return distance <= reach / resolution;
}

/// Settled vectors, continued smoothly over all others.
cv::Mat continued(const cv::Mat& flow, const cv::Mat& settled) {
  cv::Mat smooth;
  cv::GaussianBlur(fillHoles(flow, settled), smooth, cv::Size(), kSmoothing, kSmoothing, cv::BORDER_REPLICATE);
  return smooth;
}

/// Second height less the first where a flow leads [px].
cv::Mat heightChange(const Pair& pair, const cv::Mat& flow) {
  cv::Mat there;
  cv::remap(pair.second_height, there, flowTargets(flow), {}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return there - pair.first_height;
}

/// How far tissue moves sideways for each unit that it moves in height.
struct Slant {
  cv::Vec2d per_height{0, 0};
  double explained = 0;  // part of the sideways motion's variance, 0...1
};

/// Robust straight-line fit over settled vectors.
Slant fitSlant(const cv::Mat& flow, const cv::Mat& change, const cv::Mat& settled) {
  constexpr int kStep = 3, kRounds = 6;
  constexpr double kTolerance = 9, kLeastSquare = 0.01;  // of squared residuals: of their median, and [px^2]
  struct Vector {
    cv::Vec2d sideways;
    double height, weight;
  };
  std::vector<Vector> vectors;
  for (int row = 0; row < flow.rows; row += kStep)
    for (int column = 0; column < flow.cols; column += kStep)
      if (settled.at<uchar>(row, column) != 0)
        vectors.push_back({cv::Vec2d(flow.at<cv::Vec2f>(row, column)), change.at<float>(row, column), 1});
  Slant slant;
  if (vectors.empty()) return slant;
  for (int round = 0; round < kRounds; ++round) {
    double total = 0, mean_height = 0, heights = 1e-9, all = 1e-9, rest = 0;
    cv::Vec2d mean(0, 0), product(0, 0);
    for (const Vector& v : vectors) {
      total += v.weight;
      mean_height += v.weight * v.height;
      mean += v.weight * v.sideways;
    }
    mean_height /= total;
    mean /= total;
    for (const Vector& v : vectors) {
      const double height = v.height - mean_height;
      const cv::Vec2d sideways = v.sideways - mean;
      heights += v.weight * height * height;
      product += v.weight * height * sideways;
      all += v.weight * sideways.dot(sideways);
    }
    slant.per_height = product / heights;
    std::vector<double> squares;
    for (const Vector& v : vectors) {
      const cv::Vec2d left = v.sideways - mean - slant.per_height * (v.height - mean_height);
      squares.push_back(left.dot(left));
      rest += v.weight * squares.back();
    }
    slant.explained = 1 - rest / all;
    std::vector<double> sorted = squares;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double scale = std::max(kTolerance * *middle, kLeastSquare);
    for (std::size_t i = 0; i < vectors.size(); ++i) vectors[i].weight = scale / (scale + squares[i]);
  }
  return slant;
}

/// Settled vectors, continued over all others. A brain that sags moves in one direction, which is not exactly the
/// projection's: where its height has changed more it has also moved more sideways. If the settled vectors show this
/// relation, the others are guessed from their own change of height, wherever the images then agree better than with a
/// smooth continuation.
cv::Mat continuedAlongHeight(const Pair& pair, const cv::Mat& flow, const cv::Mat& settled) {
  constexpr double kExplained = 0.5;
  constexpr int kRounds = 8;
  const cv::Mat plain = continued(flow, settled);
  const Slant slant = fitSlant(flow, heightChange(pair, flow), settled);
  if (slant.explained < kExplained) return plain;
  const auto sideways = [&](const cv::Mat& motion) {
    cv::Mat smooth, both;
    cv::GaussianBlur(heightChange(pair, motion), smooth, cv::Size(), kSmoothing, kSmoothing, cv::BORDER_REPLICATE);
    cv::merge(std::vector<cv::Mat>{smooth * slant.per_height[0], smooth * slant.per_height[1]}, both);
    return both;
  };
  const cv::Mat rest = continued(flow - sideways(flow), settled);
  cv::Mat slanted = plain;
  for (int round = 0; round < kRounds; ++round) slanted = 0.5 * slanted + 0.5 * (rest + sideways(slanted));
  const auto fit = [&](const cv::Mat& motion) {
    return agreementOf(pair.first, pair.second, motion, pair.resolution).correlation;
  };
  cv::Mat best = plain.clone(), smooth;
  slanted.copyTo(best, fit(slanted) > fit(plain));
  cv::GaussianBlur(best, smooth, cv::Size(), kSmoothing, kSmoothing, cv::BORDER_REPLICATE);
  return smooth;
}

/// Averages blocks of `step` x `step` pixels; a block counts where most of it does.
void shrink(const cv::Mat& colour, const cv::Mat& usable, int step, cv::Mat& small, cv::Mat& small_usable) {
  if (step == 1) {
    small = colour;
    small_usable = usable;
    return;
  }
  const cv::Size size(colour.cols / step, colour.rows / step);
  const cv::Rect whole(0, 0, size.width * step, size.height * step);
  cv::resize(fillHoles(colour, usable)(whole), small, size, 0, 0, cv::INTER_AREA);
  cv::Mat share;
  cv::resize(usable(whole), share, size, 0, 0, cv::INTER_AREA);
  small_usable = share > 127;
}

Pair pairOf(const Projection& earlier, const Projection& later, const cv::Mat& earlier_usable,
            const cv::Mat& later_usable, int step, const std::string& channels, double detail) {
  Pair pair;
  pair.resolution = earlier.resolution * step;
  const auto see = [&](const Projection& projection, const cv::Mat& usable, Seen& seen) {
    shrink(projection.colour, usable, step, seen.colour, seen.usable);
    seen.pattern = flowImage(seen.colour, seen.usable, channels, detail);
  };
  sideBySide({[&] { see(earlier, earlier_usable, pair.first); }, [&] { see(later, later_usable, pair.second); }});
  return pair;
}

/// CV_32FC1 [px of the coarser grid], continued over holes.
cv::Mat heightsOf(const Projection& projection, int step) {
  cv::Mat heights = projection.height.clone(), small, covered;
  cv::patchNaNs(heights, 0);
  shrink(heights, projection.mask, step, small, covered);
  return fillHoles(small, covered) / (projection.resolution * step);
}

bool largeEnough(cv::Size size, int step) {
  constexpr int kFewest = 16;  // pixels a side that the flow takes
  return std::min(size.width, size.height) / step >= kFewest;
}

/// A flow on a grid that is `step` times finer.
cv::Mat refined(const cv::Mat& flow, cv::Size size, int step) {
  if (step == 1) return flow;
  cv::Mat map(size, CV_32FC2), fine;
  const auto at = [&](int i) { return (static_cast<float>(i) - 0.5F * static_cast<float>(step - 1)) / step; };
  for (int row = 0; row < size.height; ++row)
    for (int column = 0; column < size.width; ++column) map.at<cv::Vec2f>(row, column) = {at(column), at(row)};
  cv::remap(flow, fine, map, {}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return step * fine;
}

/// The motion, starting from `guess`: the second image is warped by the guess, and the rest of the motion is measured.
/// @param domain CV_8UC1: what of the first image may take part, or empty: all
FlowResult look(const Pair& pair, const cv::Mat& guess, const cv::Mat& domain, bool search,
                const ImageMatchingSettings& settings) {
  cortshift_flow::FlowSettings flow = settings.flow;
  flow.curvature = 16 * pair.resolution * settings.bend;  // a second difference over 4 px [px]
  // One smooth surface, whose own word about its error is what probabilityOfMatch was fitted on; shading makes all of
  // it unsure on a coarse grid.
  flow.judge = 0;
  const double side = pair.resolution * std::min(pair.first.pattern.cols, pair.first.pattern.rows);
  flow.search_range = std::clamp((search ? settings.search : kRestSearch) / side, 0.01, 0.5);
  if (guess.empty())
    return cortshift_flow::computeFlow(pair.first.pattern, pair.second.pattern, pair.first.usable, pair.second.usable,
                                       flow);
  const cv::Mat map = flowTargets(guess);
  // A new image: assigning the result to an existing one would overwrite the caller's pixels.
  const cv::Mat usable = domain.empty() ? pair.first.usable : cv::Mat(pair.first.usable & domain);
  cv::Mat near, near_usable;
  cv::remap(pair.second.pattern, near, map, {}, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  cv::remap(pair.second.usable, near_usable, map, {}, cv::INTER_NEAREST, cv::BORDER_CONSTANT, 0);
  if (!domain.empty()) near_usable &= domain;
  FlowResult result = cortshift_flow::computeFlow(pair.first.pattern, near, usable, near_usable, flow);
  cv::Mat guess_there;  // near(y) is second(y + guess(y)), so the whole motion is rest(x) + guess(x + rest(x))
  cv::remap(guess, guess_there, flowTargets(result.flow), {}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  result.flow += guess_there;
  return result;
}

/// Part of what both images show that has settled.
double partOf(const cv::Mat& settled, const cv::Mat& first_usable, const cv::Mat& second_usable) {
  const cv::Mat overlap = first_usable & second_usable;
  const int all = cv::countNonZero(overlap);
  return all == 0 ? 0.0 : static_cast<double>(cv::countNonZero(settled & overlap)) / all;
}

double partOf(const cv::Mat& settled, const Pair& pair) {
  return partOf(settled, pair.first.usable, pair.second.usable);
}

}  // namespace

void ImageMatchingSettings::validate() const {
  if (channels != "auto" && channels != "rgb" && channels != "green" && channels != "blue" && channels != "luminance")
    throw TrackingError("channels = '" + channels + "' is not allowed; allowed is auto, rgb, green, blue or luminance");
  cortshift_flow::requireRange<TrackingError>("detail", detail, 0.5, 100.0);
  cortshift_flow::requireRange<TrackingError>("bend", bend, 0.01, 1000.0);
  cortshift_flow::requireRange<TrackingError>("search", search, 0.001, 0.05);
  cortshift_flow::requireRange<TrackingError>("coarse_resolution", coarse_resolution, 0.00005, 0.002);
  cortshift_flow::requireRange<TrackingError>("coarse_rounds", coarse_rounds, 0, 10);
  flow.validate();
}

cv::Mat predictionOf(const cv::Mat& flow, const cv::Mat& confidence) { return continued(flow, confidence >= kSettled); }

bool isFollowed(const cv::Mat& probability, const cv::Mat& earlier_usable, const cv::Mat& later_usable) {
  return partOf(probability >= kSettled, earlier_usable, later_usable) >= kFollowed;
}

std::string chooseChannels(const Projection& earlier, const Projection& later, const cv::Mat& earlier_usable,
                           const cv::Mat& later_usable, const ImageMatchingSettings& settings) {
  int step = std::max(1, static_cast<int>(std::lround(kQuickResolution / earlier.resolution)));
  if (!largeEnough(earlier.mask.size(), step)) step = 1;
  std::string best = "rgb";
  double most = -kBetter;
  for (const char* channels : {"rgb", "green", "blue", "luminance"}) {
    const Pair pair = pairOf(earlier, later, earlier_usable, later_usable, step, channels, settings.detail);
    const double part = partOf(settledMask(pair, look(pair, {}, {}, true, settings)), pair);
    if (part <= most + kBetter) continue;
    best = channels;
    most = part;
  }
  return best;
}

ProjectionMatch matchProjections(const Projection& earlier, const Projection& later, const cv::Mat& earlier_usable,
                                 const cv::Mat& later_usable, const ImageMatchingSettings& settings,
                                 const cv::Mat& prediction) {
  settings.validate();
  std::string channels = settings.channels == "auto" ? "rgb" : settings.channels;
  const auto pairAt = [&](int step) {
    // A motion that is nearly known is measured with finer detail than one that must be found first.
    const double detail = step > 1 ? kCoarseDetail * settings.detail : settings.detail;
    return pairOf(earlier, later, earlier_usable, later_usable, step, channels, detail);
  };
  const cv::Size size = earlier.mask.size();
  cv::Mat guess = prediction, domain;
  // First looks on a coarser grid cost little, and the last look measures best when the motion is nearly known.
  int step = std::max(1, static_cast<int>(std::lround(settings.coarse_resolution / earlier.resolution)));
  if (!largeEnough(size, step)) step = 1;
  const int rounds = prediction.empty() ? settings.coarse_rounds - (step == 1 ? 1 : 0) : 0;
  if (rounds > 0) {
    Pair pair = pairAt(step);
    pair.first_height = heightsOf(earlier, step);
    pair.second_height = heightsOf(later, step);
    cv::Mat coarse, settled;
    double part = 0;
    for (int round = 0; round < rounds; ++round) {
      FlowResult result = look(pair, coarse, domain, coarse.empty(), settings);
      settled = settledMask(pair, result);
      if (round == 0 && settings.channels == "auto" && partOf(settled, pair) < kFollowed) {
        channels = chooseChannels(earlier, later, earlier_usable, later_usable, settings);
        if (channels != "rgb") {
          Pair other = pairAt(step);
          pair.first = other.first;
          pair.second = other.second;
          result = look(pair, coarse, domain, coarse.empty(), settings);
          settled = settledMask(pair, result);
        }
      }
      coarse = continuedAlongHeight(pair, result.flow, settled);
      domain = around(settled, kReach, pair.resolution);
      const double before = part;
      part = partOf(settled, pair);
      if (1 - part < kWorthARound || part - before < kLeastGain) break;
    }
    guess = refined(coarse, size, step);
    cv::resize(around(settled, kLastReach, pair.resolution), domain, size, 0, 0, cv::INTER_NEAREST);
  }
  const Pair pair = pairAt(1);
  const FlowResult result = look(pair, guess, domain, rounds <= 0, settings);
  if (rounds <= 0) {
    if (!prediction.empty() || settings.channels != "auto") return {result, channels};
    // No first look has chosen the channels.
    if (partOf(settledMask(pair, result), pair) >= kFollowed) return {result, channels};
    channels = chooseChannels(earlier, later, earlier_usable, later_usable, settings);
    return {channels == "rgb" ? result : look(pairAt(1), guess, domain, true, settings), channels};
  }
  // Where the coarse grid gave a wrong start, the settled vectors around it give a better one; and the domain now
  // includes tissue that has settled since.
  const cv::Mat settled = settledMask(pair, result);
  const double part = partOf(settled, pair);
  if (1 - part < kLeastGain) return {result, channels};
  const FlowResult again =
      look(pair, continued(result.flow, settled), around(settled, kLastReach, pair.resolution), false, settings);
  return {partOf(settledMask(pair, again), pair) > part ? again : result, channels};
}

}  // namespace cortshift_tracking
