#include "cortshift_stereo/reconstruction.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <opencv2/core/utility.hpp>
#include <string>

#include "cortshift_stereo/geometry/triangulation.hpp"
#include "cortshift_stereo/refinement/refinement.hpp"

namespace cortshift_stereo {
namespace {

constexpr float kAgreement = 1.5f;  // [px] between matching and refinement; beyond, one of them is wrong

std::string describe(const cv::Size& size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

void checkSize(const cv::Mat& image, const CameraModel& camera, const std::string& side) {
  if (image.size() != camera.size)
    throw PairError("image_size", "The " + side + " image is " + describe(image.size()) +
                                      ", but its calibration is for " + describe(camera.size) +
                                      ": set the camera's resolution or calibrate again.");
}

/// Points only where both images have pixels of a mask.
void keepWhereBoth(cv::Mat& disparity, const cv::Mat& left_mask, const cv::Mat& right_mask) {
  cv::parallel_for_(cv::Range(0, disparity.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      float* d = disparity.ptr<float>(y);
      const uint8_t* left = left_mask.ptr<uint8_t>(y);
      const uint8_t* right = right_mask.ptr<uint8_t>(y);
      for (int x = 0; x < disparity.cols; ++x) {
        const float partner = static_cast<float>(x) - d[x] + 0.5f;  // rounded by cutting off the fraction
        const bool inside = partner >= 0 && partner < static_cast<float>(disparity.cols);  // not for NaN
        if (!inside || !left[x] || !right[static_cast<int>(partner)]) d[x] = std::numeric_limits<float>::quiet_NaN();
      }
    }
  });
}

/// Points only where refinement stayed with the match and knows enough.
void keepWhereCertain(cv::Mat& disparity, const cv::Mat& match, const cv::Mat& deviation, double max_deviation) {
  const auto most = static_cast<float>(max_deviation);
  cv::parallel_for_(cv::Range(0, disparity.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      float* d = disparity.ptr<float>(y);
      const float *matched = match.ptr<float>(y), *expected = deviation.ptr<float>(y);
      for (int x = 0; x < disparity.cols; ++x) {
        const bool agrees = std::abs(matched[x] - d[x]) < kAgreement;  // not for NaN
        if (!agrees || expected[x] > most) d[x] = std::numeric_limits<float>::quiet_NaN();
      }
    }
  });
}

double shareOfValid(const cv::Mat& disparity) {
  return static_cast<double>(cv::countNonZero(disparity == disparity)) / static_cast<double>(disparity.total());
}

void checkCoverage(double coverage, const PairLimits& limits) {
  if (coverage < limits.min_coverage)
    throw PairError("coverage", "Only " + number(100 * coverage) + " % of the image could be matched, at least " +
                                    number(100 * limits.min_coverage) +
                                    " % is needed: check focus, light, obstacles in the view, and the calibration.");
}

/// What a pair shows by one rectification.
struct Matching {
  RectifiedPair pair;
  cv::Mat disparity, deviation;
  ReconstructionQuality quality;
};

Matching matchPair(const cv::Mat& left, const cv::Mat& right, const Rectifier& rectifier,
                   const ReconstructionSettings& settings) {
  const StereoModel& model = rectifier.model();
  Matching out;
  out.pair = rectifier.rectify(left, right);
  const RectifiedPair& pair = out.pair;
  const SearchRange possible = possibleRange(model, settings.min_working_distance, settings.max_working_distance);
  out.quality.search_range = usedRange(pair.left_sharp, pair.right_sharp, model, possible, settings.relief);
  if (out.quality.search_range.size() == 0)
    throw PairError("no_match", "The two images do not match at any working distance between " +
                                    number(settings.min_working_distance) + " and " +
                                    number(settings.max_working_distance) +
                                    " m: check that both belong to one pair, that left and right are not swapped, and "
                                    "the calibration.");
  out.disparity = matchByStructure(pair.left_sharp, pair.right_sharp, out.quality.search_range);
  const cv::Mat match = out.disparity.clone();
  keepWhereBoth(out.disparity, pair.left_usable, pair.right_usable);
  if (pair.has_highlights) dropIslands(out.disparity);
  const RefinedDisparity refined = refineDisparity(pair, out.disparity);
  out.disparity = refined.disparity;
  out.deviation = refined.deviation;
  keepWhereCertain(out.disparity, match, refined.deviation, settings.max_deviation);
  keepWhereBoth(out.disparity, pair.left_seen, pair.right_seen);
  out.quality.coverage = std::min(1.0, shareOfValid(out.disparity) / std::max(1e-6, rectifier.leftShare()));
  out.quality.epipolar = agreementOf(matchPoints(pair, out.disparity), rectifier);
  return out;
}

/// Depth in the middle of what was found [m].
double typicalDepth(const cv::Mat& disparity, const StereoModel& model) {
  std::vector<float> known;
  constexpr int kStep = 8;
  for (int y = 0; y < disparity.rows; y += kStep)
    for (int x = 0; x < disparity.cols; x += kStep)
      if (const float d = disparity.at<float>(y, x); std::isfinite(d)) known.push_back(d);
  if (known.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = known.begin() + static_cast<std::ptrdiff_t>(known.size() / 2);
  std::nth_element(known.begin(), middle, known.end());
  return depthOfDisparity(model, *middle);
}

}  // namespace

void ReconstructionSettings::validate() const {
  const auto require = [](bool good, const std::string& name, double value, const std::string& allowed) {
    if (!good) throw std::invalid_argument(name + " = " + number(value) + " is not allowed; allowed is " + allowed);
  };
  require(min_working_distance > 0, "min_working_distance", min_working_distance, "> 0 m");
  require(max_working_distance > min_working_distance, "max_working_distance", max_working_distance,
          "> min_working_distance");
  require(max_deviation > 0, "max_deviation", max_deviation, "> 0 px");
  require(relief >= 0, "relief", relief, ">= 0 m");
}

ReconstructionResult reconstruct(const cv::Mat& left, const cv::Mat& right, const Rectifier& rectifier,
                                 const ReconstructionSettings& settings) {
  settings.validate();
  const int64_t start = cv::getTickCount();
  const StereoModel& model = rectifier.model();
  const PairLimits& limits = settings.limits;
  checkSize(left, model.left, "left");
  checkSize(right, model.right, "right");

  ReconstructionResult result;
  ReconstructionQuality& quality = result.quality;
  cv::parallel_for_(cv::Range(0, 2), [&](const cv::Range& sides) {
    for (int side = sides.start; side < sides.end; ++side)
      (side == 0 ? quality.left : quality.right) = measureImage(side == 0 ? left : right);
  });
  checkImage(quality.left, limits, "left");
  checkImage(quality.right, limits, "right");

  checkAlikeSharp(quality.left, quality.right, limits);

  // A small turn of the right camera shows in the rows: it is taken out, and what is left of it once more.
  constexpr int kTurns = 2;
  Matching found = matchPair(left, right, rectifier, settings);
  cv::Vec3d taken(0, 0, 0);
  RowVerdict verdict = judgeRows(found.quality.epipolar, limits);
  for (int turn = 0; turn < kTurns && verdict.turn; ++turn) {
    taken += *verdict.turn;
    const Rectifier turned = rectifier.withRightTurned(taken);
    found = matchPair(left, right, turned, settings);
    verdict = judgeRows(found.quality.epipolar, limits);
  }
  checkCoverage(found.quality.coverage, limits);
  quality.search_range = found.quality.search_range;
  quality.coverage = found.quality.coverage;
  quality.epipolar = found.quality.epipolar;
  result.disparity = found.disparity;
  result.warnings = warningsOfRows(quality.epipolar, taken, model.baseline(), typicalDepth(result.disparity, model),
                                   model.right.P(1, 1));
  Surface& surface = result.surface_left;
  surface.colour = found.pair.left_colour;
  surface.points = triangulate(result.disparity, model);
  surface.confidence = confidenceOf(found.deviation);
  surface.confidence.setTo(0, ~(result.disparity == result.disparity));

  result.seconds = static_cast<double>(cv::getTickCount() - start) / cv::getTickFrequency();
  return result;
}

}  // namespace cortshift_stereo
