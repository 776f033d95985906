#include "cortshift_stereo/averaging/frame_average.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cortshift_stereo/geometry/triangulation.hpp"
#include "cortshift_stereo/refinement/refinement.hpp"

namespace cortshift_stereo {
namespace {

/// Mean of the values near their median, and the variance of that mean.
struct RobustMean {
  float value;
  float variance;
};

RobustMean robustMean(std::vector<float>& values, std::vector<float>& distances) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  const float median = *middle;
  distances.resize(values.size());
  std::transform(values.begin(), values.end(), distances.begin(), [&](float v) { return std::abs(v - median); });
  const auto half = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), half, distances.end());
  constexpr float kLeastReach = 0.05f;  // [px]
  const float reach = std::max(kLeastReach, 3 * 1.4826f * *half);
  float sum = 0, squares = 0, count = 0;
  for (const float v : values) {
    if (std::abs(v - median) > reach) continue;
    sum += v - median;
    squares += (v - median) * (v - median);
    count += 1;
  }
  const float mean = sum / count;
  const float variance = count > 1 ? std::max(0.0f, squares - count * mean * mean) / (count - 1) / count : 0.0f;
  return {median + mean, variance};
}

}  // namespace

ReconstructionResult averageFrames(const std::vector<Frame>& frames, const StereoModel& model) {
  CV_Assert(!frames.empty());
  const cv::Size size = frames.front().disparity.size();
  ReconstructionResult result;
  result.disparity = cv::Mat(size, CV_32FC1, cv::Scalar(std::numeric_limits<float>::quiet_NaN()));
  cv::Mat deviation = result.disparity.clone();
  cv::Mat colour(size, CV_8UC3);
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
    std::vector<float> values, distances;
    for (int y = rows.start; y < rows.end; ++y)
      for (int x = 0; x < size.width; ++x) {
        values.clear();
        cv::Vec3i sum(0, 0, 0);
        float promised = 0;  // variance that a frame's confidence stands for
        for (const Frame& frame : frames) {
          sum += cv::Vec3i(frame.colour.at<cv::Vec3b>(y, x));
          const float d = frame.disparity.at<float>(y, x), c = frame.confidence.at<float>(y, x);
          if (std::isnan(d) || !(c > 0)) continue;
          values.push_back(d);
          promised += static_cast<float>(std::pow(deviationOf(c), 2));
        }
        for (int i = 0; i < 3; ++i)
          colour.at<cv::Vec3b>(y, x)[i] =
              cv::saturate_cast<uint8_t>(static_cast<double>(sum[i]) / static_cast<double>(frames.size()));
        const auto count = static_cast<float>(values.size());
        if (values.empty() || 2 * values.size() < frames.size()) continue;
        const RobustMean mean = robustMean(values, distances);
        result.disparity.at<float>(y, x) = mean.value;
        deviation.at<float>(y, x) = std::sqrt(std::max(promised / count / count, mean.variance));
      }
  });
  result.surface_left = {triangulate(result.disparity, model), colour, confidenceOf(deviation)};
  return result;
}

}  // namespace cortshift_stereo
