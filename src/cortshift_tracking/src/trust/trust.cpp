#include "cortshift_tracking/trust/trust.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "cortshift_flow/range.hpp"
#include "cortshift_tracking/error.hpp"
#include "matching/flow_targets.hpp"
#include "matching/window_mean.hpp"
#include "parallel.hpp"

namespace cortshift_tracking {
namespace {

cv::Mat disc(double radius) {
  const int side = 2 * static_cast<int>(std::ceil(radius)) + 1;
  return cv::getStructuringElement(cv::MORPH_ELLIPSE, cv::Size(side, side));
}

/// The mask without its holes: those that are nowhere as wide as `width` [px], or all where no width is given.
cv::Mat fillHolesOf(const cv::Mat& mask, double width = std::numeric_limits<double>::infinity()) {
  cv::Mat framed;  // a frame of one pixel outside connects everything that is not a hole
  cv::copyMakeBorder(mask, framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, 0);
  cv::Mat labels, to_mask;
  const cv::Mat empty = framed == 0;
  const int count = cv::connectedComponents(empty, labels, 8, CV_32S);
  std::vector<float> half_width(static_cast<std::size_t>(count), 0.0F);
  if (std::isfinite(width)) {
    cv::distanceTransform(empty, to_mask, cv::DIST_L2, cv::DIST_MASK_PRECISE);
    for (int row = 0; row < labels.rows; ++row)
      for (int column = 0; column < labels.cols; ++column) {
        float& widest = half_width[static_cast<std::size_t>(labels.at<int>(row, column))];
        widest = std::max(widest, to_mask.at<float>(row, column));
      }
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

/// CV_8UC1 255 further than `border` [px] inside the mask; what is beyond the image counts as outside.
cv::Mat inside(const cv::Mat& mask, double border) {
  cv::Mat framed, to_border;
  cv::copyMakeBorder(mask, framed, 1, 1, 1, 1, cv::BORDER_CONSTANT, 0);
  cv::distanceTransform(framed, to_border, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  const cv::Mat inner = to_border > border;
  return inner(cv::Rect(1, 1, mask.cols, mask.rows)).clone();
}

cv::Mat sample(const cv::Mat& image, const cv::Mat& map, int interpolation) {
  cv::Mat out;
  cv::remap(image, out, map, {}, interpolation, cv::BORDER_CONSTANT, 0);
  return out;
}

/// Root mean square deviation of the change of height from its mean over the window, for vectors that end at `map`
/// [m]: CV_32FC1.
cv::Mat roughnessOf(const Projection& earlier, const Projection& later, const cv::Mat& map, double window) {
  cv::Mat first = earlier.height.clone(), second = later.height.clone();
  cv::patchNaNs(first, 0);
  cv::patchNaNs(second, 0);
  cv::Mat covered = sample(later.mask, map, cv::INTER_LINEAR) == 255;
  covered &= earlier.mask;
  covered.convertTo(covered, CV_32F, 1.0 / 255.0);
  const WindowMean mean(covered, window, earlier.resolution);
  const cv::Mat change = sample(second, map, cv::INTER_LINEAR) - first;
  const cv::Mat deviation = change - mean.of(change);
  cv::Mat roughness;
  cv::sqrt(mean.of(deviation.mul(deviation)), roughness);
  return roughness;
}

/// Sets the confidence to 0 in small patches of vectors that seem right: smaller than four of the windows in which the
/// images were compared, or narrower than one everywhere. Among vectors that are probably wrong, a few seem right by
/// chance.
void dropIslands(cv::Mat& confidence, double window) {
  constexpr double kProbable = 0.5;
  const cv::Mat probable = confidence >= kProbable;
  cv::Mat labels, statistics, centroids, to_edge;
  const int count = cv::connectedComponentsWithStats(probable, labels, statistics, centroids, 4, CV_32S);
  cv::distanceTransform(probable, to_edge, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  std::vector<char> kept(static_cast<std::size_t>(count), 0);
  for (int row = 0; row < labels.rows; ++row)
    for (int column = 0; column < labels.cols; ++column)
      if (2 * to_edge.at<float>(row, column) >= window) kept[static_cast<std::size_t>(labels.at<int>(row, column))] = 1;
  for (int label = 1; label < count; ++label)
    if (statistics.at<int>(label, cv::CC_STAT_AREA) < 4 * window * window) kept[static_cast<std::size_t>(label)] = 0;
  for (int row = 0; row < labels.rows; ++row)
    for (int column = 0; column < labels.cols; ++column) {
      const int label = labels.at<int>(row, column);
      if (label > 0 && kept[static_cast<std::size_t>(label)] == 0) confidence.at<float>(row, column) = 0;
    }
}

}  // namespace

void TrustSettings::validate() const {
  cortshift_flow::requireRange<TrackingError>("border", border, 0.0, 0.02);
  cortshift_flow::requireRange<TrackingError>("hole_border", hole_border, 0.0, 0.02);
  cortshift_flow::requireRange<TrackingError>("glare", glare, 0.5, 1.0);
  cortshift_flow::requireRange<TrackingError>("glare_margin", glare_margin, 0.0, 0.01);
  agreement.validate();
}

cv::Mat usableMask(const Projection& projection, const TrustSettings& settings) {
  settings.validate();
  cv::Mat glare(projection.mask.size(), CV_8UC1);
  const auto limit = static_cast<float>(settings.glare);
  parallelRanges(glare.rows, 0, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int column = 0; column < glare.cols; ++column) {
        const cv::Vec3f& c = projection.colour.at<cv::Vec3f>(row, column);
        glare.at<uchar>(row, column) = std::min({c[0], c[1], c[2]}) >= limit ? 255 : 0;
      }
  });
  if (settings.glare_margin > 0) cv::dilate(glare, glare, disc(settings.glare_margin / projection.resolution));
  cv::Mat usable = projection.mask.clone();
  usable.setTo(0, projection.fold);
  usable.setTo(0, glare);
  return usable;
}

cv::Mat erodeBorder(const cv::Mat& mask, double border, double hole_border) {
  cv::Mat inner = mask.clone();
  if (border > 0) inner &= inside(fillHolesOf(mask), border);
  if (hole_border > 0) inner &= inside(fillHolesOf(mask, hole_border), hole_border);
  return inner;
}

double overlapOf(const Projection& earlier, const Projection& later) {
  const int area = cv::countNonZero(earlier.mask);
  return area == 0 ? 0.0 : static_cast<double>(cv::countNonZero(earlier.mask & later.mask)) / area;
}

VectorEvidence evidenceOf(const Projection& earlier, const Projection& later, const ProjectionMatch& match,
                          const cv::Mat& height_errors, const cv::Mat& earlier_usable, const cv::Mat& later_usable,
                          const TrustSettings& settings) {
  settings.validate();
  const auto inner = [&](const Projection& projection) {
    return erodeBorder(projection.mask, settings.border / projection.resolution,
                       settings.hole_border / projection.resolution);
  };
  const cv::Mat map = flowTargets(match.flow);
  const std::string channels = match.channels == "rgb" ? "luminance" : match.channels;
  const auto seen = [&](const Projection& projection, const cv::Mat& usable) -> Seen {
    return {flowImage(projection.colour, usable, channels, ImageMatchingSettings().detail), projection.colour, usable};
  };
  VectorEvidence evidence;
  evidence.resolution = earlier.resolution;
  evidence.flow_confidence = match.confidence;
  evidence.height_errors = height_errors;
  Seen first, second;
  cv::Mat start_inside, end_inside;
  sideBySide({[&] { first = seen(earlier, earlier_usable); }, [&] { second = seen(later, later_usable); },
              [&] { start_inside = inner(earlier); }, [&] { end_inside = inner(later); },
              [&] { evidence.roughness = roughnessOf(earlier, later, map, settings.agreement.window); }});
  evidence.agreement = agreementOf(first, second, match.flow, earlier.resolution, settings.agreement);
  evidence.allowed = start_inside & earlier_usable & sample(end_inside & later_usable, map, cv::INTER_NEAREST);
  return evidence;
}

cv::Mat probabilityOfMatch(const VectorEvidence& evidence) {
  return probabilityOfMatch(evidence.flow_confidence, evidence.agreement, evidence.resolution);
}

cv::Mat confidenceOf(const VectorEvidence& evidence, const cv::Mat& probability_of_match,
                     const TrustSettings& settings) {
  cv::Mat confidence = probability_of_match.clone();
  parallelRanges(confidence.rows, 0, [&](int first, int last) {
    for (int row = first; row < last; ++row)
      for (int column = 0; column < confidence.cols; ++column)
        confidence.at<float>(row, column) *= probabilityOfHeight(
            {evidence.roughness.at<float>(row, column), evidence.height_errors.at<float>(row, column)});
  });
  confidence.setTo(0, evidence.allowed == 0);
  dropIslands(confidence, settings.agreement.window / evidence.resolution);
  return confidence;
}

}  // namespace cortshift_tracking
