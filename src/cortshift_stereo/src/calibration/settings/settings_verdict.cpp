#include "cortshift_stereo/calibration/settings/settings_verdict.hpp"

#include <opencv2/imgproc.hpp>

#include "cortshift_flow/text.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::formatted;

// Pixels outside the boards have no point at any other setting: half the image is what a craniotomy fills.
constexpr double kLargeRegion = 0.5;

double regionShare(const WarpModel& model) {
  const std::vector<cv::Point2f> region(model.region.begin(), model.region.end());
  return cv::contourArea(region) / model.size.area();
}

void judgeSide(const std::string& side, const SettingsCalibration& calibration, CalibrationVerdict& verdict) {
  verdict.judge(calibration.held_out_rms, kHarmlessPixels, kLargestHeldOutRms,
                side +
                    formatted(": settings that took no part are missed by %.2f px (good is %.2f px)",
                              calibration.held_out_rms, kHarmlessPixels) +
                    ": take a denser grid of settings, and check that neither board nor microscope moves");
  const double region = regionShare(calibration.warp.model());
  if (region < kLargeRegion)
    verdict.add(
        Grade::kDoubtful,
        side + formatted(": boards cover %.0f %% of the image (good are %.0f %%)", 100 * region, 100 * kLargeRegion) +
            ": add a larger board, seen at the reference and at low magnification");
}

}  // namespace

CalibrationVerdict judgeSettings(const SettingsCalibration& left, const SettingsCalibration& right,
                                 std::size_t without_board) {
  CalibrationVerdict verdict;
  judgeSide("left", left, verdict);
  judgeSide("right", right, verdict);
  const double left_out = static_cast<double>(left.rejected.size() + right.rejected.size() + without_board);
  const double offered = left_out + static_cast<double>(left.residuals.size() + right.residuals.size());
  verdict.judge(left_out / offered, kFewLeftOut, kMostLeftOut,
                formatted("%.0f of %.0f images do not fit the others or show no board", left_out, offered) +
                    ": look at their reasons and take them again");
  return verdict;
}

}  // namespace cortshift_stereo
