#include "cortshift_tracking/registration.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "cortshift_tracking/agreement.hpp"
#include "cortshift_tracking/error.hpp"
#include "flow_targets.hpp"
#include "range.hpp"

namespace cortshift_tracking {
namespace {

using cortshift_flow::FlowResult;

constexpr double kSettled = 0.5;             // probability from which a vector may guide others
constexpr double kWorthARound = 0.02;        // part of the overlap that must be unsettled for another first look
constexpr double kLeastGain = 0.0005;        // part of the overlap that a look must settle for another to follow
constexpr double kCoarseDetail = 2;          // detail of first looks over that of the last
constexpr double kRestSearch = 0.0015;       // what may be left of the motion after a look [m]
constexpr double kSmoothing = 4;             // standard deviation, of a continued flow [px]
constexpr double kQuickResolution = 0.0004;  // of the looks that choose the channels [m]
constexpr double kFollowed = 0.75;           // part of the overlap from which all three channels are good enough
constexpr double kBetter = 0.02;  // part of the overlap that other channels must win to be preferred to all three

/// The pair of images on a grid, as the flow sees them.
struct Pair {
  cv::Mat first, second, first_usable, second_usable;
  double resolution = 0;  // [m]
};

/// CV_8UC1 255: vectors that are probably right.
cv::Mat settledMask(const Pair& pair, const FlowResult& result) {
  const Agreement agreement =
      agreementOf(pair.first, pair.second, pair.first_usable, pair.second_usable, result.flow, pair.resolution);
  return probabilityOfMatch(result.confidence, agreement, pair.resolution) >= kSettled;
}

/// Settled vectors, continued smoothly over all others.
cv::Mat continued(const cv::Mat& flow, const cv::Mat& settled) {
  cv::Mat smooth;
  cv::GaussianBlur(fillHoles(flow, settled), smooth, cv::Size(), kSmoothing, kSmoothing, cv::BORDER_REPLICATE);
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
  cv::Mat colour;
  shrink(earlier.colour, earlier_usable, step, colour, pair.first_usable);
  pair.first = flowImage(colour, pair.first_usable, channels, detail);
  shrink(later.colour, later_usable, step, colour, pair.second_usable);
  pair.second = flowImage(colour, pair.second_usable, channels, detail);
  return pair;
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

/// The motion from where `guess` leads: the second image is brought near by it, and what remains is measured.
FlowResult look(const Pair& pair, const cv::Mat& guess, bool search, const RegistrationSettings& settings) {
  cortshift_flow::FlowSettings flow = settings.flow;
  flow.curvature = 16 * pair.resolution * settings.bend;  // a second difference over 4 px [px]
  const double side = pair.resolution * std::min(pair.first.cols, pair.first.rows);
  flow.search_range = std::clamp((search ? settings.search : kRestSearch) / side, 0.01, 0.5);
  if (guess.empty())
    return cortshift_flow::computeFlow(pair.first, pair.second, pair.first_usable, pair.second_usable, flow);
  const cv::Mat map = flowTargets(guess);
  cv::Mat near, near_usable;
  cv::remap(pair.second, near, map, {}, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  cv::remap(pair.second_usable, near_usable, map, {}, cv::INTER_NEAREST, cv::BORDER_CONSTANT, 0);
  FlowResult result = cortshift_flow::computeFlow(pair.first, near, pair.first_usable, near_usable, flow);
  cv::Mat guess_there;  // near(y) is second(y + guess(y)), so the whole motion is rest(x) + guess(x + rest(x))
  cv::remap(guess, guess_there, flowTargets(result.flow), {}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  result.flow += guess_there;
  return result;
}

/// Part of what both images show that has settled.
double partOf(const cv::Mat& settled, const Pair& pair) {
  const cv::Mat overlap = pair.first_usable & pair.second_usable;
  const int all = cv::countNonZero(overlap);
  return all == 0 ? 0.0 : static_cast<double>(cv::countNonZero(settled & overlap)) / all;
}

}  // namespace

void RegistrationSettings::validate() const {
  if (channels != "auto" && channels != "rgb" && channels != "green" && channels != "blue" && channels != "luminance")
    throw TrackingError("channels = '" + channels + "' is not allowed; allowed is auto, rgb, green, blue or luminance");
  requireRange("detail", detail, 0.5, 100.0);
  requireRange("bend", bend, 0.01, 1000.0);
  requireRange("search", search, 0.001, 0.05);
  requireRange("coarse_resolution", coarse_resolution, 0.00005, 0.002);
  requireRange("coarse_rounds", coarse_rounds, 0, 10);
  flow.validate();
}

cv::Mat predictionOf(const cv::Mat& flow, const cv::Mat& confidence) { return continued(flow, confidence >= kSettled); }

std::string chooseChannels(const Projection& earlier, const Projection& later, const cv::Mat& earlier_usable,
                           const cv::Mat& later_usable, const RegistrationSettings& settings) {
  int step = std::max(1, static_cast<int>(std::lround(kQuickResolution / earlier.resolution)));
  if (!largeEnough(earlier.mask.size(), step)) step = 1;
  std::string best = "rgb";
  double most = -kBetter;
  for (const char* channels : {"rgb", "green", "blue", "luminance"}) {
    const Pair pair = pairOf(earlier, later, earlier_usable, later_usable, step, channels, settings.detail);
    const double part = partOf(settledMask(pair, look(pair, {}, true, settings)), pair);
    if (part <= most + kBetter) continue;
    best = channels;
    most = part;
  }
  return best;
}

FlowResult registerProjections(const Projection& earlier, const Projection& later, const cv::Mat& earlier_usable,
                               const cv::Mat& later_usable, const RegistrationSettings& settings,
                               const cv::Mat& prediction) {
  settings.validate();
  std::string channels = settings.channels == "auto" ? "rgb" : settings.channels;
  const auto pairAt = [&](int step) {
    // What is nearly known can be followed by finer detail than what must be found first.
    const double detail = step > 1 ? kCoarseDetail * settings.detail : settings.detail;
    return pairOf(earlier, later, earlier_usable, later_usable, step, channels, detail);
  };
  const cv::Size size = earlier.mask.size();
  cv::Mat guess = prediction;
  // First looks are cheap on a coarser grid, and a motion that is nearly known is measured best.
  int step = std::max(1, static_cast<int>(std::lround(settings.coarse_resolution / earlier.resolution)));
  if (!largeEnough(size, step)) step = 1;
  const int rounds = prediction.empty() ? settings.coarse_rounds - (step == 1 ? 1 : 0) : 0;
  if (rounds > 0) {
    Pair pair = pairAt(step);
    cv::Mat coarse;
    double part = 0;
    for (int round = 0; round < rounds; ++round) {
      FlowResult result = look(pair, coarse, coarse.empty(), settings);
      cv::Mat settled = settledMask(pair, result);
      if (round == 0 && settings.channels == "auto" && partOf(settled, pair) < kFollowed) {
        channels = chooseChannels(earlier, later, earlier_usable, later_usable, settings);
        if (channels != "rgb") {
          pair = pairAt(step);
          result = look(pair, coarse, coarse.empty(), settings);
          settled = settledMask(pair, result);
        }
      }
      coarse = continued(result.flow, settled);
      const double before = part;
      part = partOf(settled, pair);
      if (1 - part < kWorthARound || part - before < kLeastGain) break;
    }
    guess = refined(coarse, size, step);
  }
  return look(pairAt(1), guess, rounds <= 0, settings);
}

}  // namespace cortshift_tracking
