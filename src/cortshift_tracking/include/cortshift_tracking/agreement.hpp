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

/// Two images with their local brightness divided out, compared in a window around each pixel of the first. Blood, a
/// changed surface and a wrong match lower the agreement, and so does lack of texture.
struct Agreement {
  cv::Mat correlation;  ///< CV_32FC1 -1...1; 0 where nothing can be compared
  cv::Mat residual;     ///< CV_32FC1 standard deviation of the difference, of a mean brightness of 0.5
};

/// @param first, second as of flowImage(); second(x + flow(x)) is compared with first(x)
/// @param first_usable, second_usable CV_8UC1
/// @param resolution of the grid [m]
Agreement agreementOf(const cv::Mat& first, const cv::Mat& second, const cv::Mat& first_usable,
                      const cv::Mat& second_usable, const cv::Mat& flow, double resolution,
                      const AgreementSettings& settings = {});

/// Probability that a vector is right to 0.25 mm, from the flow's own predicted error and the images' agreement: a
/// logistic model.
/// @param flow_error predicted error of the flow [m]
double probabilityOfMatch(double flow_error, double correlation, double residual);

/// The same for a whole flow: CV_32FC1 0...1.
/// @param flow_confidence CV_32FC1 0...1 of computeFlow()
cv::Mat probabilityOfMatch(const cv::Mat& flow_confidence, const Agreement& agreement, double resolution);

}  // namespace cortshift_tracking
