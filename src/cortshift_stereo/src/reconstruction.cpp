#include "cortshift_stereo/reconstruction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core/utility.hpp>
#include <string>

#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/geometry/triangulation.hpp"
#include "cortshift_stereo/refinement/refinement.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::shortNumber;

constexpr float kAgreement = 1.5f;  // [px] between matching and refinement; beyond, one of them is wrong

std::string describe(const cv::Size& size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

Findings checkSize(const cv::Mat& image, const CameraModel& camera, const std::string& side) {
  Findings found;
  if (image.size() != camera.size)
    found.refuse(CheckId::kImageSize, "The " + side + " image",
                 "is " + describe(image.size()) + ", but its calibration is for " + describe(camera.size),
                 "set the camera's resolution or calibrate again");
  return found;
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

/// Keeps points only where the refined disparity is near the matched one and its expected error is small.
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

Findings checkCoverage(double coverage, const PairLimits& limits) {
  Findings found;
  if (coverage < limits.min_coverage)
    found.refuse(CheckId::kCoverage, "The match",
                 "covers only " + shortNumber(100 * coverage) + " % of the image, at least " +
                     shortNumber(100 * limits.min_coverage) + " % is needed",
                 "check focus, light, obstacles in the view, and the calibration");
  return found;
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
  out.pair = rectifier.rectifySharp(left, right);
  RectifiedPair& pair = out.pair;
  const SearchRange possible = possibleRange(model, settings.min_working_distance, settings.max_working_distance);
  out.quality.search_range = usedRange(pair.left_sharp, pair.right_sharp, model, possible, settings.relief);
  if (out.quality.search_range.size() == 0)
    throw PairError(CheckId::kNoMatch, "The pair",
                    "does not match at any working distance between " + shortNumber(settings.min_working_distance) +
                        " and " + shortNumber(settings.max_working_distance) + " m",
                    "check that both images belong to one pair, that left and right are not swapped, and the "
                    "calibration");
  out.disparity = matchByStructure(pair.left_sharp, pair.right_sharp, out.quality.search_range);
  const cv::Mat match = out.disparity.clone();
  keepWhereBoth(out.disparity, pair.left_usable, pair.right_usable);
  if (pair.has_highlights) dropIslands(out.disparity);
  rectifier.mixGrey(left, right, out.disparity, pair);
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

/// Matches a pair and takes out a small turn of its right camera, and once more what is left of it.
/// @param taken  [rad] the turn that was taken out
/// @throws PairError
Matching matchAligned(const cv::Mat& left, const cv::Mat& right, const Rectifier& rectifier,
                      const ReconstructionSettings& settings, cv::Vec3d& taken) {
  constexpr int kTurns = 2;
  taken = {0, 0, 0};
  Matching found = matchPair(left, right, rectifier, settings);
  for (int turns = 0;; ++turns) {
    const RowVerdict rows = judgeRows(found.quality.epipolar, settings.limits);
    rows.findings.requireAccepted();
    if (!rows.turn || turns == kTurns) break;
    taken += *rows.turn;
    found = matchPair(left, right, rectifier.withRightTurned(taken), settings);
  }
  checkCoverage(found.quality.coverage, settings.limits).requireAccepted();
  return found;
}

/// Whether a pair that is refused would be accepted with its images exchanged.
bool fitsExchanged(const cv::Mat& left, const cv::Mat& right, const Rectifier& rectifier,
                   const ReconstructionSettings& settings) {
  try {
    cv::Vec3d taken;
    matchAligned(right, left, rectifier, settings, taken);
    return true;
  } catch (const PairError&) {
    return false;
  }
}

}  // namespace

void ReconstructionSettings::validate() const {
  const auto require = [](bool good, const std::string& name, double value, const std::string& allowed) {
    if (!good)
      throw std::invalid_argument(name + " = " + shortNumber(value) + " is not allowed; allowed is " + allowed);
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
  checkSize(left, model.left, "left").requireAccepted();
  checkSize(right, model.right, "right").requireAccepted();

  ReconstructionResult result;
  ReconstructionQuality& quality = result.quality;
  cv::parallel_for_(cv::Range(0, 2), [&](const cv::Range& sides) {
    for (int side = sides.start; side < sides.end; ++side)
      (side == 0 ? quality.left : quality.right) = measureImage(side == 0 ? left : right);
  });
  checkImage(quality.left, limits, "left").requireAccepted();
  checkImage(quality.right, limits, "right").requireAccepted();

  checkAlikeSharp(quality.left, quality.right, limits).requireAccepted();

  Matching found;
  cv::Vec3d taken;
  try {
    found = matchAligned(left, right, rectifier, settings, taken);
  } catch (const PairError& error) {
    if (error.finding().check == CheckId::kSwapped || !fitsExchanged(left, right, rectifier, settings)) throw;
    throw PairError(CheckId::kSwapped, "Left and right",
                    "are swapped: the pair fits when they are exchanged, but not as it is (" + error.finding().thing +
                        " " + error.finding().reason + ")",
                    "exchange the cables or the topics");
  }
  quality.search_range = found.quality.search_range;
  quality.coverage = found.quality.coverage;
  quality.epipolar = found.quality.epipolar;
  result.disparity = found.disparity;
  result.warnings = warningsOfRows(quality.epipolar, taken, model, typicalDepth(result.disparity, model)).warnings();
  Surface& surface = result.surface_left;
  surface.colour = found.pair.left_colour;
  surface.points = triangulate(result.disparity, model);
  surface.confidence = confidenceOf(found.deviation);
  surface.confidence.setTo(0, ~(result.disparity == result.disparity));

  result.seconds = static_cast<double>(cv::getTickCount() - start) / cv::getTickFrequency();
  return result;
}

}  // namespace cortshift_stereo
