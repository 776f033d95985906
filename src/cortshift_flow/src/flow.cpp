#include "cortshift_flow/flow.hpp"

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <stdexcept>
#include <string>

namespace cortshift_flow {
namespace {

cv::Mat greyBytes(const cv::Mat& image) {
  cv::Mat grey = image;
  if (image.channels() == 3) cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  const double scale = image.depth() == CV_8U ? 1.0 : image.depth() == CV_16U ? 1.0 / 257.0 : 255.0;
  grey.convertTo(grey, CV_8U, scale);
  return grey;
}

cv::Mat consistency(const cv::Mat& forward, const cv::Mat& backward) {
  cv::Mat confidence(forward.size(), CV_32F, cv::Scalar(0));
  for (int y = 0; y < forward.rows; ++y)
    for (int x = 0; x < forward.cols; ++x) {
      const cv::Vec2f w = forward.at<cv::Vec2f>(y, x);
      const int xs = cvRound(x + w[0]), ys = cvRound(y + w[1]);
      if (xs < 0 || ys < 0 || xs >= forward.cols || ys >= forward.rows) continue;
      const double gap = cv::norm(w + backward.at<cv::Vec2f>(ys, xs));
      confidence.at<float>(y, x) = static_cast<float>(1.0 / (1.0 + gap * gap));
    }
  return confidence;
}

}  // namespace

void FlowSettings::validate() const {
  if (threads < 0)
    throw std::invalid_argument("threads = " + std::to_string(threads) + " is not allowed; 0 or more is");
}

FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const cv::Mat& second_mask,
                       const FlowSettings& settings) {
  settings.validate();
  if (first.empty() || second.empty()) throw std::invalid_argument("an image is empty");
  if (first.size() != second.size() || first.type() != second.type())
    throw std::invalid_argument("the images differ in size or type");
  const cv::Mat a = greyBytes(first), b = greyBytes(second);
  const auto flowBetween = [](const cv::Mat& from, const cv::Mat& to) {
    cv::Mat flow;
    cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM)->calc(from, to, flow);
    const auto refinement = cv::VariationalRefinement::create();
    refinement->setAlpha(80);
    refinement->setFixedPointIterations(5);
    refinement->setSorIterations(10);
    for (int round = 0; round < 3; ++round) refinement->calc(from, to, flow);
    return flow;
  };
  FlowResult result;
  result.flow = flowBetween(a, b);
  result.confidence = consistency(result.flow, flowBetween(b, a));
  if (!mask.empty()) result.confidence.setTo(0, mask == 0);
  (void)second_mask;
  return result;
}

FlowResult computeFlow(const cv::Mat& first, const cv::Mat& second, const cv::Mat& mask, const FlowSettings& settings) {
  return computeFlow(first, second, mask, {}, settings);
}

}  // namespace cortshift_flow
