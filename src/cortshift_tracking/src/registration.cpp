#include "cortshift_tracking/registration.hpp"

#include <opencv2/imgproc.hpp>

#include "cortshift_tracking/error.hpp"
#include "flow_targets.hpp"
#include "range.hpp"

namespace cortshift_tracking {
namespace {

cv::Mat selectChannels(const cv::Mat& colour, const std::string& channels) {
  cv::Mat selected;
  if (channels == "rgb") return colour;
  if (channels == "luminance") {
    cv::cvtColor(colour, selected, cv::COLOR_BGR2GRAY);
  } else {
    cv::extractChannel(colour, selected, channels == "green" ? 1 : 0);
  }
  return selected;
}

using cortshift_flow::FlowResult;

constexpr float kSettled = 0.3F;       // confidence from which a vector needs no second look and may guide others
constexpr double kWorthARound = 0.03;  // part of the overlap that must be unsettled, or be won, for another round

/// The settled vectors, continued smoothly over all others.
cv::Mat continued(const FlowResult& result) {
  const cv::Mat settled = result.confidence >= kSettled;
  cv::Mat guess = fillHoles(result.flow, settled), smooth;
  cv::GaussianBlur(guess, smooth, cv::Size(), 4, 4, cv::BORDER_REPLICATE);
  return smooth;
}

/// Another look from a better start: the later image is brought near by `guess`, and what remains is measured. Vectors
/// that come out surer than before replace those of `result`.
/// @return part of the image that became settled
double lookAgain(const cv::Mat& first, const cv::Mat& second, const cv::Mat& first_usable, const cv::Mat& second_usable,
                 const RegistrationSettings& settings, FlowResult& result) {
  const cv::Mat guess = continued(result), map = flowTargets(guess);
  cv::Mat near, near_usable;
  cv::remap(second, near, map, {}, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  cv::remap(second_usable, near_usable, map, {}, cv::INTER_NEAREST, cv::BORDER_CONSTANT, 0);
  const FlowResult rest = cortshift_flow::computeFlow(first, near, first_usable, near_usable, settings.flow);
  cv::Mat guess_there;  // near(y) is second(y + guess(y)), so the whole motion is rest(x) + guess(x + rest(x))
  cv::remap(guess, guess_there, flowTargets(rest.flow), {}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  const cv::Mat surer = rest.confidence > result.confidence, unsettled = result.confidence < kSettled;
  const cv::Mat replaced = surer & unsettled;
  const int settled = cv::countNonZero(replaced & (rest.confidence >= kSettled));
  cv::Mat(rest.flow + guess_there).copyTo(result.flow, replaced);
  rest.confidence.copyTo(result.confidence, replaced);
  return static_cast<double>(settled) / static_cast<double>(first.total());
}

}  // namespace

void RegistrationSettings::validate() const {
  if (channels != "rgb" && channels != "green" && channels != "blue" && channels != "luminance")
    throw TrackingError("channels = '" + channels + "' is not allowed; allowed is rgb, green, blue or luminance");
  requireRange("more_rounds", more_rounds, 0, 5);
  flow.validate();
}

cortshift_flow::FlowResult registerProjections(const Projection& earlier, const Projection& later,
                                               const cv::Mat& earlier_usable, const cv::Mat& later_usable,
                                               const RegistrationSettings& settings) {
  settings.validate();
  const cv::Mat first = fillHoles(selectChannels(earlier.colour, settings.channels), earlier_usable);
  const cv::Mat second = fillHoles(selectChannels(later.colour, settings.channels), later_usable);
  FlowResult result = cortshift_flow::computeFlow(first, second, earlier_usable, later_usable, settings.flow);
  // Steep strain, as at the rim of a sagging brain, can lose the flow although all around it is sure.
  const cv::Mat overlap = earlier_usable & later_usable;
  for (int round = 0; round < settings.more_rounds; ++round) {
    const int unsettled = cv::countNonZero((result.confidence < kSettled) & overlap);
    if (unsettled <= kWorthARound * cv::countNonZero(overlap)) break;
    if (lookAgain(first, second, earlier_usable, later_usable, settings, result) < kWorthARound) break;
  }
  return result;
}

}  // namespace cortshift_tracking
