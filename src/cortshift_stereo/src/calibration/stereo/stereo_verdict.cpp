#include "cortshift_stereo/calibration/stereo/stereo_verdict.hpp"

#include <algorithm>
#include <cmath>

#include "cortshift_flow/text.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::formatted;

// A pair whose rows disagree by more than 1 px is refused (max_epipolar_residual of the reconstruction).
constexpr double kUsablePixels = 1.0;
// What both cameras together add to the error of each alone. One pose less for each view costs 3 % (54 corners); at
// twice the error, three quarters of its square are not the corners'.
constexpr double kLikeAlone = 1.3;
constexpr double kUnlikeAlone = 2.0;
// Distortion grows with the third power of the radius, and so does what is wrong with it: beyond corners that reach 0.6
// of the way, an error of 0.05 px there is 0.05 / 0.6^3 = 0.23 px in the corner of the image.
constexpr double kFarReach = 0.6;
// A shift of 20 mm, the largest reported, is off by 0.2 mm at 1 %.
constexpr double kHarmlessFocalDeviation = 0.01;
// What OpenCV's guide asks for.
constexpr std::size_t kGoodPairs = 10;
// Working distances of microscopes and endoscopes [m]; farther boards have wrong squares.
constexpr double kNearest = 0.05, kFarthest = 1.0;

}  // namespace

CalibrationVerdict judgeStereo(const StereoCalibration& calibration, const std::optional<SetErrors>& checks) {
  CalibrationVerdict verdict;
  const double joint = calibration.used.reprojection_rms;
  const double alone = std::max(calibration.left_alone_rms, calibration.right_alone_rms);
  if (joint > kHarmlessPixels)
    verdict.judge(joint / alone, kLikeAlone, kUnlikeAlone,
                  formatted("both cameras together miss the corners by %.2f px, each alone by %.2f px", joint, alone) +
                      ": the boards were not taken at the same time (or the cameras moved between); fire both cameras "
                      "by one trigger, or hold the board still on a stand");
  SetErrors held_out = checks ? *checks : calibration.scores.front().held_out;
  if (!checks)
    for (const auto& score : calibration.scores)
      if (score.model == calibration.model) held_out = score.held_out;
  verdict.judge(held_out.epipolar_rms, kHarmlessPixels, kUsablePixels,
                formatted("rows of views that took no part disagree by %.2f px (good is %.2f px)",
                          held_out.epipolar_rms, kHarmlessPixels) +
                    ": take sharp views of a flat board with both cameras at rest");
  const double offered = static_cast<double>(calibration.used.pairs.size() + calibration.screened.size());
  verdict.judge(
      static_cast<double>(calibration.screened.size()) / offered, kFewLeftOut, kMostLeftOut,
      formatted("%.0f of %.0f views do not fit the others", static_cast<double>(calibration.screened.size()), offered) +
          ": look at their reasons and take them again");
  if (calibration.reach < kFarReach)
    verdict.add(Grade::kDoubtful,
                formatted("the boards reach only %.0f %% of the way to a corner of the image (good is %.0f "
                          "%%)",
                          100 * calibration.reach, 100 * kFarReach) +
                    ": take views with the board in every corner");
  if (calibration.focal_deviation > kHarmlessFocalDeviation)
    verdict.add(Grade::kDoubtful, formatted("a focal length is known to %.1f %% only (good is %.0f %%)",
                                            100 * calibration.focal_deviation, 100 * kHarmlessFocalDeviation) +
                                      ": take views tilted by 20 to 40 degrees in all directions");
  if (calibration.used.pairs.size() < kGoodPairs)
    verdict.add(Grade::kDoubtful,
                formatted("only %.0f views were used (good are %.0f)",
                          static_cast<double>(calibration.used.pairs.size()), static_cast<double>(kGoodPairs)) +
                    ": take more");
  if (calibration.distance < kNearest || calibration.distance > kFarthest)
    verdict.add(Grade::kDoubtful,
                formatted("the boards would be %.2f m away: is the side of a square right (metres, not millimetres)?",
                          calibration.distance));
  return verdict;
}

}  // namespace cortshift_stereo
