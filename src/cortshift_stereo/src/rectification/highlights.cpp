#include "rectification/highlights.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cortshift_stereo {
namespace {

constexpr int kSaturated = 250;  // [grey levels] in two channels at least: no texture is left there

// Glow is looked for in a reduced image, so that its size follows that of the image. Lengths in reduced pixels.
constexpr int kReducedWidth = 512;
constexpr float kReach = 12;  // of glow from saturated pixels
constexpr float kRim = 2.3f;  // around saturated pixels, not part of the surroundings
constexpr int kSurroundings = 15;
constexpr float kSpreads = 1.5f;

/// Empty where nothing is saturated.
cv::Mat saturatedPixels(const cv::Mat& bgr) {
  cv::Mat mask(bgr.size(), CV_8UC1);
  bool any = false;
  for (int y = 0; y < bgr.rows; ++y) {
    const uint8_t* from = bgr.ptr<uint8_t>(y);
    uint8_t* to = mask.ptr<uint8_t>(y);
    for (int x = 0; x < bgr.cols; ++x) {
      const int channels =
          (from[3 * x] >= kSaturated) + (from[3 * x + 1] >= kSaturated) + (from[3 * x + 2] >= kSaturated);
      const bool saturated = channels >= 2;
      any |= saturated;
      to[x] = saturated ? 255 : 0;
    }
  }
  return any ? mask : cv::Mat();
}

/// Means over the surroundings of the least and the greatest channel and of their products.
cv::Mat momentsAround(const cv::Mat& bgr, const cv::Mat& distance) {
  using Moments = cv::Vec<float, 6>;
  cv::Mat moments(bgr.size(), CV_32FC(6), cv::Scalar(0));
  for (int y = 0; y < bgr.rows; ++y)
    for (int x = 0; x < bgr.cols; ++x) {
      if (distance.at<float>(y, x) <= kRim) continue;
      const auto& pixel = bgr.at<cv::Vec3b>(y, x);
      const auto [low, high] = std::minmax({pixel[0], pixel[1], pixel[2]});
      const float least = low, greatest = high;
      moments.at<Moments>(y, x) = Moments(1, least, greatest, least * least, least * greatest, greatest * greatest);
    }
  cv::boxFilter(moments, moments, -1, {kSurroundings, kSurroundings}, {-1, -1}, false, cv::BORDER_CONSTANT);
  return moments;
}

/// CV_8UC1, 255 on glow, at reduced size.
cv::Mat reducedGlow(const cv::Mat& bgr, const cv::Mat& saturated) {
  cv::Mat distance, glow(bgr.size(), CV_8UC1);
  cv::distanceTransform(~saturated, distance, cv::DIST_L2, 3);
  const cv::Mat moments = momentsAround(bgr, distance);
  for (int y = 0; y < bgr.rows; ++y)
    for (int x = 0; x < bgr.cols; ++x) {
      const auto* m = moments.ptr<float>(y) + 6 * x;
      const auto isGlow = [&] {
        if (saturated.at<uint8_t>(y, x)) return true;
        if (distance.at<float>(y, x) > kReach) return false;
        if (m[0] < 1) return true;  // nothing but highlights around
        const float mean = m[1] / m[0], colour = m[1] / std::max(1.0f, m[2]);
        const auto& pixel = bgr.at<cv::Vec3b>(y, x);
        const auto [least, greatest] = std::minmax({pixel[0], pixel[1], pixel[2]});
        const float brighter = static_cast<float>(least) - mean;
        const float whiter = static_cast<float>(least) - colour * static_cast<float>(greatest);
        const float spread2 = m[3] / m[0] - mean * mean;
        const float white_spread2 = (m[3] - 2 * colour * m[4] + colour * colour * m[5]) / m[0];
        constexpr float kSpreads2 = kSpreads * kSpreads;
        return brighter > 0 && whiter > 0 && brighter * brighter > kSpreads2 * spread2 &&
               whiter * whiter > kSpreads2 * white_spread2;
      };
      glow.at<uint8_t>(y, x) = isGlow() ? 255 : 0;
    }
  cv::dilate(glow, glow, cv::Mat());
  return glow;
}

}  // namespace

Highlights findHighlights(const cv::Mat& bgr) {
  CV_Assert(bgr.type() == CV_8UC3);
  Highlights found;
  const cv::Mat saturated = saturatedPixels(bgr);
  if (saturated.empty()) return found;
  cv::dilate(saturated, found.saturated, cv::Mat());
  const int shrink = std::max(1, cvRound(static_cast<double>(bgr.cols) / kReducedWidth));
  const cv::Size reduced((bgr.cols + shrink - 1) / shrink, (bgr.rows + shrink - 1) / shrink);
  cv::Mat bgr_reduced, share;
  cv::resize(bgr, bgr_reduced, reduced, 0, 0, cv::INTER_AREA);
  cv::resize(saturated, share, reduced, 0, 0, cv::INTER_AREA);
  cv::resize(reducedGlow(bgr_reduced, share > 0), found.glow, bgr.size(), 0, 0, cv::INTER_NEAREST);
  found.glow |= found.saturated;
  return found;
}

}  // namespace cortshift_stereo
