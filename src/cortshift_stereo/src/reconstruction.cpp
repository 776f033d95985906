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

Findings checkMatch(const ReconstructionQuality& quality, const PairLimits& limits) {
  constexpr int kFewestCorners = 20;
  const EpipolarResidual& epipolar = quality.epipolar;
  constexpr double kPlainlyBetter = 0.5;
  Findings found;
  if (epipolar.matched >= kFewestCorners && epipolar.spread_if_swapped < kPlainlyBetter * epipolar.spread)
    found.refuse(CheckId::kSwapped, "Left and right",
                 "are swapped: the rows of the two images agree to " + shortNumber(epipolar.spread_if_swapped) +
                     " px when exchanged, but to " + shortNumber(epipolar.spread) + " px as they are",
                 "exchange the cables or the topics");
  if (epipolar.matched >= kFewestCorners && epipolar.spread > limits.max_epipolar_residual)
    found.refuse(CheckId::kEpipolar, "The rows of the two images",
                 "do not agree (median vertical gap " + shortNumber(epipolar.spread) + " px over " +
                     std::to_string(epipolar.matched) + " corners, at most " +
                     shortNumber(limits.max_epipolar_residual) + " px is allowed)",
                 "the images are not of one pair, or the cameras moved since their calibration; calibrate again");
  if (quality.coverage < limits.min_coverage)
    found.refuse(CheckId::kCoverage, "The match",
                 "covers only " + shortNumber(100 * quality.coverage) + " % of the image, at least " +
                     shortNumber(100 * limits.min_coverage) + " % is needed",
                 "check focus, light, obstacles in the view, and the calibration");
  if (epipolar.matched < kFewestCorners)
    found.refuse(CheckId::kNoMatch, "The match",
                 "rests on only " + std::to_string(epipolar.matched) + " corners found in both images, at least " +
                     std::to_string(kFewestCorners) + " are needed to trust the pair",
                 "check that both images show the same scene");
  return found;
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

  const RectifiedPair pair = rectifier.rectify(left, right);
  const SearchRange possible = possibleRange(model, settings.min_working_distance, settings.max_working_distance);
  quality.search_range = usedRange(pair.left_sharp, pair.right_sharp, model, possible, settings.relief);
  if (quality.search_range.size() == 0)
    throw PairError(CheckId::kNoMatch, "The pair",
                    "does not match at any working distance between " + shortNumber(settings.min_working_distance) +
                        " and " + shortNumber(settings.max_working_distance) + " m",
                    "check that both images belong to one pair, that left and right are not swapped, and the "
                    "calibration");
  result.disparity = matchByStructure(pair.left_sharp, pair.right_sharp, quality.search_range);
  const cv::Mat match = result.disparity.clone();
  keepWhereBoth(result.disparity, pair.left_usable, pair.right_usable);
  if (pair.has_highlights) dropIslands(result.disparity);
  const RefinedDisparity refined = refineDisparity(pair, result.disparity);
  result.disparity = refined.disparity;
  keepWhereCertain(result.disparity, match, refined.deviation, settings.max_deviation);
  keepWhereBoth(result.disparity, pair.left_seen, pair.right_seen);

  quality.coverage = std::min(1.0, shareOfValid(result.disparity) / std::max(1e-6, rectifier.leftShare()));
  Surface& surface = result.surface_left;
  surface.colour = pair.left_colour;
  cv::parallel_for_(cv::Range(0, 2), [&](const cv::Range& tasks) {
    for (int task = tasks.start; task < tasks.end; ++task) {
      if (task == 0) {
        quality.epipolar = measureEpipolarResidual(pair, result.disparity, rectifier);
        continue;
      }
      surface.points = triangulate(result.disparity, model);
      surface.confidence = confidenceOf(refined.deviation);
      surface.confidence.setTo(0, ~(result.disparity == result.disparity));
    }
  });
  checkMatch(quality, limits).requireAccepted();

  result.seconds = static_cast<double>(cv::getTickCount() - start) / cv::getTickFrequency();
  return result;
}

}  // namespace cortshift_stereo
