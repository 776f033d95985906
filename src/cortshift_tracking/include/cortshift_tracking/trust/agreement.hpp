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
};

/// @param flow [grid units]; second(x + flow(x)) is compared with first(x)
/// @param resolution of the grid [m]
Agreement agreementOf(const Seen& first, const Seen& second, const cv::Mat& flow, double resolution,
                      const AgreementSettings& settings = {});

/// Evidence about one vector of a flow.
struct MatchEvidence {
  float flow_error = 0;   ///< the flow's own predicted error [m]
  float correlation = 0;  ///< this and the following: see Agreement
  float residual = 0;
  float hue = 0;
  float bend = 0;
};

/// Probability that the vector is right to 0.25 mm within the plane of the projection: a logistic model.
float probabilityOfMatch(const MatchEvidence& evidence);

/// The same for a whole flow: CV_32FC1 0...1.
/// @param flow_confidence CV_32FC1 0...1 of computeFlow()
cv::Mat probabilityOfMatch(const cv::Mat& flow_confidence, const Agreement& agreement, double resolution);

/// Evidence about the two heights that a vector leads from and to.
struct HeightEvidence {
  float roughness = 0;  ///< root mean square deviation of the change of height from its mean over the window [m]
  float deviation = 0;  ///< standard deviation of the change of height that the two surfaces expect [m]
};

/// Probability that the change of height is right to 0.25 mm where the vector is right within the plane: that neither
/// something else lies at one end (a logistic model of roughness), nor an error as the surfaces expect exceeds 0.25 mm
/// (normal distribution).
float probabilityOfHeight(const HeightEvidence& evidence);

}  // namespace cortshift_tracking
