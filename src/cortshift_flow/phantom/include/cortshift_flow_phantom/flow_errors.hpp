// How wrong a flow is: the figures of Ji et al. 2014, section 3.1, against a known truth.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_flow_phantom/planar_phantom.hpp"

namespace cortshift_flow_phantom {

/// Endpoint errors over one region [px]; shares are 0...1.
struct ErrorStatistics {
  int pixels = 0;
  double median = 0, mean = 0, percentile_95 = 0, largest = 0;
  double share_over_005 = 0, share_over_05 = 0;  ///< of pixels wrong by more than 0.05 px, 0.5 px
};

/// Endpoint error per pixel, CV_32FC1 [px].
cv::Mat endpointError(const cv::Mat& flow, const cv::Mat& truth);

/// @param region  CV_8UC1, non-zero where errors count; empty: everywhere
ErrorStatistics errorStatistics(const cv::Mat& endpoint_error, const cv::Mat& region);

/// Mean width of the band at the rim that is wrong by more than 0.5 px: the area of such pixels less than 60 px from
/// the rim (blood and patch apart), divided by the rim's length [px].
double rimBandWidth(const cv::Mat& endpoint_error, const PlanarPhantom& phantom);

/// How far the confidence tells wrong from right inside a region.
struct ConfidenceStatistics {
  double caught = 1;  ///< share of the pixels wrong by more than `wrong` whose confidence is below 0.5
  double kept = 1;    ///< share of the pixels right to 0.1 px whose confidence is not
};
ConfidenceStatistics confidenceStatistics(const cv::Mat& endpoint_error, const cv::Mat& confidence,
                                          const cv::Mat& region, double wrong = 0.5);

}  // namespace cortshift_flow_phantom
