// The motion between two projection images (Ji et al. 2014, section 2.4 on the images of 2.5).
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "cortshift_flow/flow.hpp"
#include "cortshift_tracking/projection/projection.hpp"

namespace cortshift_tracking {

struct ImageMatchingSettings {
  /// What the flow sees: rgb, green, blue or luminance (paper, Discussion: bleeding), or auto: see chooseChannels.
  std::string channels = "auto";
  /// Standard deviation of the window whose mean brightness is divided out [grid units], 0.5 ... 100.
  double detail = 2;
  double bend = 20;       ///< expected second derivative of the displacement along the surface [1/m], 0.01 ... 1000
  double search = 0.007;  ///< largest motion within the plane that is looked for [m], 0.001 ... 0.05
  double coarse_resolution = 0.0002;  ///< grid of the first looks [m]; none where the grid itself is as coarse
  int coarse_rounds = 8;              ///< most first looks, each from the certain vectors of the one before, 0 ... 10
  cortshift_flow::FlowSettings flow;  ///< its curvature and search range follow from `bend` and `search`

  /// @throws TrackingError naming the setting, its value and what is allowed.
  void validate() const;
};

/// What the flow sees of an image: one channel or all three, with its local mean brightness divided out. Light and
/// shading change when the microscope or the tissue moves, and they change slowly across the surface; what is left is
/// the tissue's own pattern.
/// @param colour CV_32FC3
/// @param usable CV_8UC1: what counts; the rest is continued from its surroundings
/// @param channels any of ImageMatchingSettings::channels but auto
/// @return CV_32F with one or three channels, 0...1, about 0.5 on average
cv::Mat flowImage(const cv::Mat& colour, const cv::Mat& usable, const std::string& channels, double detail);

/// The channels with which the largest part of the overlap can be matched, by a quick flow in each; rgb if none is
/// better.
std::string chooseChannels(const Projection& earlier, const Projection& later, const cv::Mat& earlier_usable,
                           const cv::Mat& later_usable, const ImageMatchingSettings& settings = {});

/// Whether a match is good enough that no other channels need be tried.
/// @param probability CV_32FC1 0...1 that each vector is right, see probabilityOfMatch
bool isFollowed(const cv::Mat& probability, const cv::Mat& earlier_usable, const cv::Mat& later_usable);

struct ProjectionMatch : cortshift_flow::FlowResult {
  std::string channels;  ///< what the flow saw: rgb, green, blue or luminance
};

/// Flow [grid units] from the earlier to the later projection.
/// @param earlier_usable, later_usable CV_8UC1: 0 where the image must not count (holes, folds, glare, exclusions)
/// @param prediction CV_32FC2 [grid units], for instance of the moment before, to start from; or empty. With it `auto`
///   means rgb: the caller judges the match (isFollowed), and may ask again with other channels.
ProjectionMatch matchProjections(const Projection& earlier, const Projection& later, const cv::Mat& earlier_usable,
                                 const cv::Mat& later_usable, const ImageMatchingSettings& settings = {},
                                 const cv::Mat& prediction = {});

/// The certain vectors of a flow, continued smoothly over all others: a start for the next flow.
/// @param confidence CV_32FC1 0...1, see confidenceOf
cv::Mat predictionOf(const cv::Mat& flow, const cv::Mat& confidence);

/// Continues an image smoothly where `mask` is 0.
/// @param image CV_32F with one to three channels
cv::Mat fillHoles(const cv::Mat& image, const cv::Mat& mask);

}  // namespace cortshift_tracking
