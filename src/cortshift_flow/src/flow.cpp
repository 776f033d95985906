#include "cortshift_flow/flow.hpp"

#include "estimator.hpp"
#include "prepare.hpp"
#include "variational.hpp"

namespace cortshift_flow {

FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask,
                       const FlowSettings& settings) {
  settings.validate();
  checkImages(first, second, mask, second_mask);
  const int threads = settings.threads > 0 ? settings.threads : std::max(1, cv::getNumThreads());
  const Level images = prepareImages(first, second, mask, second_mask, threads);
  Estimate estimate;
  if (settings.method == Method::kVariational) {
    estimate.flow = minimiseCoarseToFine(images, settings, threads);
    estimate.confidence = cv::Mat1f(first.size(), 1.f);
  } else {
    estimate = estimateFlow(images, settings, threads);
  }
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
