#include "cortshift_tracking/registration.hpp"

#include <opencv2/imgproc.hpp>

#include "cortshift_tracking/error.hpp"

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

}  // namespace

void RegistrationSettings::validate() const {
  if (channels != "rgb" && channels != "green" && channels != "blue" && channels != "luminance")
    throw TrackingError("channels = '" + channels + "' is not allowed; allowed is rgb, green, blue or luminance");
  flow.validate();
}

cortshift_flow::FlowResult registerProjections(const Projection& earlier, const Projection& later,
                                               const cv::Mat& earlier_usable, const cv::Mat& later_usable,
                                               const RegistrationSettings& settings) {
  settings.validate();
  const cv::Mat first = fillHoles(selectChannels(earlier.colour, settings.channels), earlier_usable);
  const cv::Mat second = fillHoles(selectChannels(later.colour, settings.channels), later_usable);
  return cortshift_flow::computeFlow(first, second, earlier_usable, later_usable, settings.flow);
}

}  // namespace cortshift_tracking
