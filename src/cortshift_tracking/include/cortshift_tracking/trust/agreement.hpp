// How well two images agree where a flow says they should.
#pragma once

#include <opencv2/core.hpp>

namespace cortshift_tracking {

struct AgreementSettings {
  double window = 0.002;      ///< side of the window in which the images are compared [m], 0.0005 ... 0.02
  double image_noise = 0.01;  ///< standard deviation of the noise of the images that the flow sees, 0 ... 0.2

  /// @throws TrackingError naming the setting, its value and the allowed range.
  void validate() const;
};

/// What is compared of a stage.
struct Seen {
  cv::Mat pattern;  ///< as of flowImage(): local brightness divided out
  cv::Mat colour;   ///< CV_32FC3 0...1
  cv::Mat usable;   ///< CV_8UC1
};

/// Two stages compared in a window around each pixel of the first. Blood, an instrument, a changed surface and a wrong
/// match lower the agreement, and so does lack of texture.
struct Agreement {
  cv::Mat correlation;  ///< CV_32FC1 -1...1 of the patterns; 0 where nothing can be compared
  cv::Mat residual;     ///< CV_32FC1 standard deviation of the patterns' difference, of a mean brightness of 0.5
  cv::Mat hue;          ///< CV_32FC1 change of the colour's log ratios, less what changed everywhere
  cv::Mat bend;         ///< CV_32FC1 root mean square of the flow's deviation from its own mean over the window [m]
  /// CV_32FC1 [m]: standard deviation of a shift of the window along the direction in which the texture that both show
  /// tells least of it (aperture problem), at `image_noise`.
  cv::Mat aperture;
};

/// @param flow [grid units]; second(x + flow(x)) is compared with first(x)
/// @param resolution of the grid [m]
Agreement agreementOf(const Seen& first, const Seen& second, const cv::Mat& flow, double resolution,
                      const AgreementSettings& settings = {});

}  // namespace cortshift_tracking
