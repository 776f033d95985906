#include "images/high_pass.hpp"

#include <opencv2/imgproc.hpp>

namespace cortshift_flow {
namespace {

constexpr double kSigma = 2;  // [px of the level]

cv::Mat4f withoutSlow(const cv::Mat4f& image, float kept) {
  cv::Mat low;
  cv::GaussianBlur(image, low, cv::Size(), kSigma);
  return image - (1 - kept) * low;
}

}  // namespace

Level highPass(const Level& level, float kept) {
  return {withoutSlow(level.first, kept), withoutSlow(level.second, kept), level.first_valid, level.second_valid};
}

}  // namespace cortshift_flow
