#include "cortshift_tracking/trust.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cortshift_flow/flow.hpp"
#include "cortshift_tracking/error.hpp"
#include "flow_targets.hpp"
#include "range.hpp"

namespace cortshift_tracking {
namespace {

cv::Mat disc(double radius) {
  const int side = 2 * static_cast<int>(std::ceil(radius)) + 1;
  return cv::getStructuringElement(cv::MORPH_ELLIPSE, cv::Size(side, side));
}

/// Fills the holes that are nowhere as wide as `width` [px].
cv::Mat fillNarrowHoles(const cv::Mat& mask, double width) {
  cv::Mat framed;  // one pixel of outside all around joins everything that is not a hole
  cv::copyMakeBorder(mask, framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, 0);
  cv::Mat labels, to_mask;
  const cv::Mat empty = framed == 0;
  const int count = cv::connectedComponents(empty, labels, 8, CV_32S);
  cv::distanceTransform(empty, to_mask, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  std::vector<float> half_width(static_cast<std::size_t>(count), 0.0F);
  for (int row = 0; row < labels.rows; ++row)
    for (int column = 0; column < labels.cols; ++column) {
      float& widest = half_width[static_cast<std::size_t>(labels.at<int>(row, column))];
      widest = std::max(widest, to_mask.at<float>(row, column));
    }
  const int outside = labels.at<int>(0, 0);
  cv::Mat filled = mask.clone();
  for (int row = 0; row < mask.rows; ++row)
    for (int column = 0; column < mask.cols; ++column) {
      const int label = labels.at<int>(row + 1, column + 1);
      if (mask.at<uchar>(row, column) == 0 && label != outside &&
          2 * half_width[static_cast<std::size_t>(label)] < width)
        filled.at<uchar>(row, column) = 255;
    }
  return filled;
}

cv::Mat luminance(const cv::Mat& colour) {
  cv::Mat grey;
  cv::cvtColor(colour, grey, cv::COLOR_BGR2GRAY);
  return grey;
}

/// The flow's confidence, which stands for an error in grid units, as one that stands for millimetres of tissue: a
/// field is as good on a fine grid as on a coarse one.
cv::Mat confidenceInSpace(const cv::Mat& flow_confidence, double resolution, double half_trust) {
  cv::Mat result(flow_confidence.size(), CV_32FC1);
  for (int row = 0; row < result.rows; ++row)
    for (int column = 0; column < result.cols; ++column) {
      const double ratio =
          cortshift_flow::predictedError(flow_confidence.at<float>(row, column)) * resolution / half_trust;
      result.at<float>(row, column) = static_cast<float>(1 / (1 + ratio * ratio));
    }
  return result;
}

cv::Mat sample(const cv::Mat& image, const cv::Mat& map, int interpolation) {
  cv::Mat out;
  cv::remap(image, out, map, {}, interpolation, cv::BORDER_CONSTANT, 0);
  return out;
}

}  // namespace

void TrustSettings::validate() const {
  requireRange("border", border, 0.0, 0.02);
  requireRange("glare", glare, 0.5, 1.0);
  requireRange("glare_margin", glare_margin, 0.0, 0.01);
  requireRange("match_window", match_window, 0.0005, 0.02);
  requireRange("half_trust", half_trust, 0.00001, 0.01);
  requireRange("image_noise", image_noise, 0.0, 0.2);
}

cv::Mat usableMask(const Projection& projection, const TrustSettings& settings) {
  settings.validate();
  cv::Mat glare(projection.mask.size(), CV_8UC1);
  const auto limit = static_cast<float>(settings.glare);
  for (int row = 0; row < glare.rows; ++row)
    for (int column = 0; column < glare.cols; ++column) {
      const cv::Vec3f& c = projection.colour.at<cv::Vec3f>(row, column);
      glare.at<uchar>(row, column) = std::min({c[0], c[1], c[2]}) >= limit ? 255 : 0;
    }
  if (settings.glare_margin > 0) cv::dilate(glare, glare, disc(settings.glare_margin / projection.resolution));
  cv::Mat usable = projection.mask.clone();
  usable.setTo(0, projection.fold);
  usable.setTo(0, glare);
  return usable;
}

cv::Mat erodeBorder(const cv::Mat& mask, double border) {
  if (!(border > 0)) return mask.clone();
  cv::Mat framed, to_border;
  cv::copyMakeBorder(fillNarrowHoles(mask, border), framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, 0);
  cv::distanceTransform(framed, to_border, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  const cv::Mat inner = to_border > border;
  return inner(cv::Rect(1, 1, mask.cols, mask.rows)) & mask;
}

double overlapOf(const Projection& earlier, const Projection& later) {
  const int area = cv::countNonZero(earlier.mask);
  return area == 0 ? 0.0 : static_cast<double>(cv::countNonZero(earlier.mask & later.mask)) / area;
}

cv::Mat matchConfidence(const Projection& earlier, const Projection& later, const cv::Mat& flow,
                        const cv::Mat& earlier_usable, const cv::Mat& later_usable, const TrustSettings& settings) {
  settings.validate();
  const cv::Mat map = flowTargets(flow);
  const cv::Mat a = luminance(earlier.colour), b = sample(luminance(later.colour), map, cv::INTER_LINEAR);
  cv::Mat weight = earlier_usable & sample(later_usable, map, cv::INTER_NEAREST);
  weight.convertTo(weight, CV_32F, 1.0 / 255.0);

  const int side = 2 * static_cast<int>(std::lround(0.5 * settings.match_window / earlier.resolution)) + 1;
  const auto windowMean = [&](const cv::Mat& values) {
    cv::Mat mean;
    cv::boxFilter(values.mul(weight), mean, CV_32F, cv::Size(side, side), {-1, -1}, true, cv::BORDER_CONSTANT);
    return mean;
  };
  const cv::Mat n = windowMean(cv::Mat::ones(a.size(), CV_32FC1)), sum_a = windowMean(a), sum_b = windowMean(b),
                sum_aa = windowMean(a.mul(a)), sum_bb = windowMean(b.mul(b)), sum_ab = windowMean(a.mul(b));
  const auto noise = static_cast<float>(settings.image_noise * settings.image_noise);
  cv::Mat confidence(a.size(), CV_32FC1, cv::Scalar(0));
  for (int row = 0; row < a.rows; ++row)
    for (int column = 0; column < a.cols; ++column) {
      const float w = n.at<float>(row, column);
      if (weight.at<float>(row, column) == 0 || w < 0.1F) continue;
      const float ma = sum_a.at<float>(row, column) / w, mb = sum_b.at<float>(row, column) / w;
      const float va = std::max(0.0F, sum_aa.at<float>(row, column) / w - ma * ma),
                  vb = std::max(0.0F, sum_bb.at<float>(row, column) / w - mb * mb),
                  cross = sum_ab.at<float>(row, column) / w - ma * mb;
      // The noise in the denominator lets the correlation fade where there is little texture to correlate.
      const float correlation = cross / std::sqrt((va + noise) * (vb + noise));
      constexpr float kWorthless = 0.3F, kSound = 0.9F;
      confidence.at<float>(row, column) = std::clamp((correlation - kWorthless) / (kSound - kWorthless), 0.0F, 1.0F);
    }
  return confidence;
}

cv::Mat combineConfidence(const Projection& earlier, const Projection& later, const cv::Mat& flow,
                          const cv::Mat& flow_confidence, const cv::Mat& earlier_usable, const cv::Mat& later_usable,
                          const TrustSettings& settings) {
  settings.validate();
  const double border = settings.border / earlier.resolution;
  const cv::Mat map = flowTargets(flow);
  const cv::Mat allowed = erodeBorder(earlier.mask, border) & earlier_usable &
                          sample(erodeBorder(later.mask, border) & later_usable, map, cv::INTER_NEAREST);
  cv::Mat confidence =
      cv::min(confidenceInSpace(flow_confidence, earlier.resolution, settings.half_trust), earlier.confidence);
  confidence = cv::min(confidence, sample(later.confidence, map, cv::INTER_LINEAR));
  confidence = cv::min(confidence, matchConfidence(earlier, later, flow, earlier_usable, later_usable, settings));
  confidence.setTo(0, allowed == 0);
  return confidence;
}

}  // namespace cortshift_tracking
