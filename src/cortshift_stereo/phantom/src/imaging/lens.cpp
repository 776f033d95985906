#include "imaging/lens.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cortshift_stereo_phantom {

cv::Mat outOfFocus(const cv::Mat& light, const cv::Mat& depth, double focus, double blur_per_metre) {
  constexpr float kStep = 0.5f, kMost = 12;  // [px] between blurred copies; their mean in between, weighted by variance
  cv::Mat_<float> blur(depth.size());
  float most = 0;
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x) {
      const double away = std::abs(depth.at<float>(y, x) - focus);
      blur(y, x) = std::isfinite(away) ? std::min(kMost, static_cast<float>(blur_per_metre * away)) : 0.0f;
      most = std::max(most, blur(y, x));
    }
  cv::Mat out = light.clone(), sharper = light;
  for (float level = kStep; level - kStep < most; level += kStep) {
    cv::Mat softer;
    cv::GaussianBlur(light, softer, {}, level, 0, cv::BORDER_REFLECT);
    const float below = level - kStep;
    cv::parallel_for_(cv::Range(0, out.rows), [&](const cv::Range& rows) {
      for (int y = rows.start; y < rows.end; ++y)
        for (int x = 0; x < out.cols; ++x) {
          const float b = blur(y, x);
          if (b <= below || b > level) continue;
          const float share = (b * b - below * below) / (level * level - below * below);
          out.at<cv::Vec3f>(y, x) = (1 - share) * sharper.at<cv::Vec3f>(y, x) + share * softer.at<cv::Vec3f>(y, x);
        }
    });
    sharper = softer;
  }
  return out;
}

cv::Mat respond(const cv::Mat& light, const ResponseSettings& response) {
  cv::Mat out = light;
  if (response.blur > 0) cv::GaussianBlur(light, out, {}, response.blur, 0, cv::BORDER_REFLECT);
  const Eigen::Vector3d gains = response.gain * response.white_balance;
  if (gains != Eigen::Vector3d::Ones()) cv::multiply(out, cv::Scalar(gains[0], gains[1], gains[2]), out);
  return out;
}

}  // namespace cortshift_stereo_phantom
