#include "cortshift_tracking/agreement.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "cortshift_flow/flow.hpp"
#include "flow_targets.hpp"
#include "range.hpp"

namespace cortshift_tracking {
namespace {

constexpr float kLeastShare = 0.1F;  // of a window that must be comparable

cv::Mat luminance(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

}  // namespace

void AgreementSettings::validate() const {
  requireRange("match_window", window, 0.0005, 0.02);
  requireRange("image_noise", image_noise, 0.0, 0.2);
}

Agreement agreementOf(const cv::Mat& first, const cv::Mat& second, const cv::Mat& first_usable,
                      const cv::Mat& second_usable, const cv::Mat& flow, double resolution,
                      const AgreementSettings& settings) {
  settings.validate();
  const cv::Mat map = flowTargets(flow);
  const cv::Mat a = luminance(first);
  cv::Mat b, weight;
  cv::remap(luminance(second), b, map, {}, cv::INTER_LINEAR, cv::BORDER_CONSTANT, 0);
  cv::remap(second_usable, weight, map, {}, cv::INTER_NEAREST, cv::BORDER_CONSTANT, 0);
  weight &= first_usable;
  weight.convertTo(weight, CV_32F, 1.0 / 255.0);

  const int side = 2 * static_cast<int>(std::lround(0.5 * settings.window / resolution)) + 1;
  const auto windowMean = [&](const cv::Mat& values) {
    cv::Mat mean;
    cv::boxFilter(values.mul(weight), mean, CV_32F, cv::Size(side, side), {-1, -1}, true, cv::BORDER_CONSTANT);
    return mean;
  };
  const cv::Mat n = windowMean(cv::Mat::ones(a.size(), CV_32FC1)), sum_a = windowMean(a), sum_b = windowMean(b),
                sum_aa = windowMean(a.mul(a)), sum_bb = windowMean(b.mul(b)), sum_ab = windowMean(a.mul(b));
  const auto noise = static_cast<float>(settings.image_noise * settings.image_noise);
  Agreement agreement{cv::Mat(a.size(), CV_32FC1, cv::Scalar(0)), cv::Mat(a.size(), CV_32FC1, cv::Scalar(1))};
  for (int row = 0; row < a.rows; ++row)
    for (int column = 0; column < a.cols; ++column) {
      const float w = n.at<float>(row, column);
      if (weight.at<float>(row, column) == 0 || w < kLeastShare) continue;
      const float ma = sum_a.at<float>(row, column) / w, mb = sum_b.at<float>(row, column) / w;
      const float va = std::max(0.0F, sum_aa.at<float>(row, column) / w - ma * ma),
                  vb = std::max(0.0F, sum_bb.at<float>(row, column) / w - mb * mb),
                  cross = sum_ab.at<float>(row, column) / w - ma * mb;
      // The noise in the denominator lets the correlation fade where there is little texture to correlate.
      agreement.correlation.at<float>(row, column) = cross / std::sqrt((va + noise) * (vb + noise));
      agreement.residual.at<float>(row, column) = std::sqrt(std::max(0.0F, va + vb - 2 * cross));
    }
  return agreement;
}

double probabilityOfMatch(double flow_error, double correlation, double residual) {
  if (!std::isfinite(flow_error)) return 0;  // the flow itself knows nothing there
  // Fitted to 120 000 vectors between the stages of the cases shift_clean, shift_disturbed and shift_wet.
  constexpr double kConstant = -12.71, kPerLogError = -0.86, kPerCorrelation = 4.26, kPerLogResidual = -1.09;
  const double error = std::clamp(flow_error, 3e-6, 1e-3), rest = std::clamp(residual, 0.002, 0.2);
  const double logit =
      kConstant + kPerLogError * std::log(error) + kPerCorrelation * correlation + kPerLogResidual * std::log(rest);
  return 1 / (1 + std::exp(-logit));
}

cv::Mat probabilityOfMatch(const cv::Mat& flow_confidence, const Agreement& agreement, double resolution) {
  cv::Mat probability(flow_confidence.size(), CV_32FC1);
  for (int row = 0; row < probability.rows; ++row)
    for (int column = 0; column < probability.cols; ++column)
      probability.at<float>(row, column) = static_cast<float>(
          probabilityOfMatch(cortshift_flow::predictedError(flow_confidence.at<float>(row, column)) * resolution,
                             agreement.correlation.at<float>(row, column), agreement.residual.at<float>(row, column)));
  return probability;
}

}  // namespace cortshift_tracking
