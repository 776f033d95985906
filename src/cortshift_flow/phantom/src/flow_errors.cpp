#include "cortshift_flow_phantom/flow_errors.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace cortshift_flow_phantom {

cv::Mat endpointError(const cv::Mat& flow, const cv::Mat& truth) {
  cv::Mat error(flow.size(), CV_32FC1);
  for (int y = 0; y < flow.rows; ++y)
    for (int x = 0; x < flow.cols; ++x) {
      const cv::Vec2f difference = flow.at<cv::Vec2f>(y, x) - truth.at<cv::Vec2f>(y, x);
      error.at<float>(y, x) = std::hypot(difference[0], difference[1]);
    }
  return error;
}

ErrorStatistics errorStatistics(const cv::Mat& endpoint_error, const cv::Mat& region) {
  std::vector<float> errors;
  for (int y = 0; y < endpoint_error.rows; ++y)
    for (int x = 0; x < endpoint_error.cols; ++x)
      if (region.empty() || region.at<uchar>(y, x)) errors.push_back(endpoint_error.at<float>(y, x));
  ErrorStatistics result;
  result.pixels = static_cast<int>(errors.size());
  if (errors.empty()) return result;
  std::sort(errors.begin(), errors.end());
  const std::size_t n = errors.size();
  const auto shareOver = [&](float limit) {
    return static_cast<double>(errors.end() - std::upper_bound(errors.begin(), errors.end(), limit)) /
           static_cast<double>(n);
  };
  double sum = 0;
  for (const float e : errors) sum += e;
  result.median = errors[n / 2];
  result.mean = sum / static_cast<double>(n);
  result.percentile_95 = errors[std::min(n - 1, n * 95 / 100)];
  result.largest = errors.back();
  result.share_over_005 = shareOver(0.05f);
  result.share_over_05 = shareOver(0.5f);
  return result;
}

double rimBandWidth(const cv::Mat& endpoint_error, const PlanarPhantom& phantom) {
  constexpr float kReach = 60;
  double wrong = 0, first_ring = 0;
  for (int y = 0; y < endpoint_error.rows; ++y)
    for (int x = 0; x < endpoint_error.cols; ++x) {
      if (!phantom.craniotomy.at<uchar>(y, x) || phantom.patch.at<uchar>(y, x) || phantom.blood.at<uchar>(y, x))
        continue;
      const float distance = phantom.rim_distance.at<float>(y, x);
      if (distance < 5) first_ring += 0.2;
      if (distance < kReach && endpoint_error.at<float>(y, x) > 0.5f) wrong += 1;
    }
  return first_ring > 0 ? wrong / first_ring : 0;
}

ConfidenceStatistics confidenceStatistics(const cv::Mat& endpoint_error, const cv::Mat& confidence,
                                          const cv::Mat& region, double wrong) {
  double wrong_pixels = 0, caught = 0, right_pixels = 0, kept = 0;
  for (int y = 0; y < endpoint_error.rows; ++y)
    for (int x = 0; x < endpoint_error.cols; ++x) {
      if (!region.empty() && !region.at<uchar>(y, x)) continue;
      const bool low = confidence.at<float>(y, x) < 0.5f;
      const float error = endpoint_error.at<float>(y, x);
      if (error > wrong) {
        wrong_pixels += 1;
        caught += low;
      } else if (error <= 0.1f) {
        right_pixels += 1;
        kept += !low;
      }
    }
  ConfidenceStatistics result;
  if (wrong_pixels > 0) result.caught = caught / wrong_pixels;
  if (right_pixels > 0) result.kept = kept / right_pixels;
  return result;
}

}  // namespace cortshift_flow_phantom
