#include "cortshift_flow/flow.hpp"

#include <cstring>

#include "estimator.hpp"
#include "images/prepare.hpp"
#include "variational/variational.hpp"

namespace cortshift_flow {
namespace {

bool identical(const cv::Mat4f& a, const cv::Mat4f& b) {
  const std::size_t row = static_cast<std::size_t>(a.cols) * a.elemSize();
  for (int y = 0; y < a.rows; ++y)
    if (std::memcmp(a.ptr(y), b.ptr(y), row) != 0) return false;
  return true;
}

/// The flow between equal images: exactly zero. (The shortened prefilter of the spline would leave some thousandths of
/// a pixel.)
Estimate noMotion(const Level& images) {
  const cv::Size size = images.first.size();
  Estimate estimate{{Plane(size), Plane(size)}, cv::Mat1f(size, 1.f)};
  if (!images.first_valid.empty()) estimate.confidence.setTo(0, images.first_valid == 0);
  return estimate;
}

/// The paper's model predicts no error: the confidence is 1 where the mask excludes nothing.
Estimate variationalEstimate(const Level& images, const FlowSettings& settings, int threads) {
  Estimate estimate = noMotion(images);
  estimate.flow = minimiseCoarseToFine(images, settings, threads);
  return estimate;
}

}  // namespace

FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask,
                       const FlowSettings& settings) {
  settings.validate();
  checkImages(first, second, mask, second_mask);
  const int threads = settings.threads > 0 ? settings.threads : std::max(1, cv::getNumThreads());
  const Level images = prepareImages(first, second, mask, second_mask, threads);
  const Estimate estimate = identical(images.first, images.second)    ? noMotion(images)
                            : settings.method == Method::kVariational ? variationalEstimate(images, settings, threads)
                                                                      : estimateFlow(images, settings, threads);
  FlowResult result;
  result.flow.create(first.size(), CV_32FC2);
  for (int y = 0; y < first.rows; ++y)
    for (int x = 0; x < first.cols; ++x)
      result.flow.at<cv::Vec2f>(y, x) = cv::Vec2f(estimate.flow.u.row(y)[x], estimate.flow.v.row(y)[x]);
  result.confidence = estimate.confidence;
  return result;
}

FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const FlowSettings& settings) {
  return computeFlow(first, second, mask, {}, settings);
}

}  // namespace cortshift_flow
