#include "cortshift_stereo/calibration/hand_eye/hand_eye_verdict.hpp"

#include <cmath>

#include "cortshift_flow/text.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_flow::formatted;

constexpr double kWorkingDistance = 0.3;  // [m] of a microscope: the lever of an error of rotation
constexpr double kUsableMetres = 1e-3;    // four times what matters: a millimetre is what navigation itself is off by
// Corrections of the tracked poses in standard deviations of the tracker: 1 is expected, twice means that three
// quarters of their square are not the tracker's, and at 5 the fit is refused.
constexpr double kLikeTracker = 2.0, kUnlikeTracker = 4.0;
// The camera's place is found from rotations: at half the rotation it is known half as well. 8 degrees are twice the
// least.
constexpr double kGoodDiversity = 2 * kLeastRotationDiversity;

}  // namespace

CalibrationVerdict judgeHandEye(const HandEyeCalibration& calibration) {
  constexpr double kMillimetre = 1e-3, kDegree = CV_PI / 180;
  CalibrationVerdict verdict;
  const double position = cv::norm(calibration.position_sd);
  const double swing = kWorkingDistance * cv::norm(calibration.rotation_sd);
  const std::string more = ": take more views, with the microscope turned by 20 to 30 degrees about all axes";
  verdict.judge(position, kHarmlessMetres, kUsableMetres,
                formatted("the camera's place is known to %.2f mm only (good is %.2f mm)", position / kMillimetre,
                          kHarmlessMetres / kMillimetre) +
                    more);
  verdict.judge(swing, kHarmlessMetres, kUsableMetres,
                formatted("the camera's direction is known to %.3f degrees only, which is %.2f mm at 300 mm",
                          cv::norm(calibration.rotation_sd) / kDegree, swing / kMillimetre) +
                    more);
  verdict.judge(
      calibration.misfit, kLikeTracker, kUnlikeTracker,
      formatted("tracked poses and images disagree by %.1f times the tracker's accuracy (good is %.0f)",
                calibration.misfit, kLikeTracker) +
          ": hold still for each view, check that pose and image are of one moment, the side of a square, the "
          "camera's calibration, and --tracker-position-sd");
  if (calibration.rotation_diversity[1] < kGoodDiversity)
    verdict.add(Grade::kDoubtful,
                formatted("the microscope was turned by %.1f degrees RMS about a second axis (good are %.0f)",
                          calibration.rotation_diversity[1] / kDegree, kGoodDiversity / kDegree) +
                    more);
  const double left_out = static_cast<double>(calibration.rejected.size());
  const double offered = left_out + static_cast<double>(calibration.residuals.size());
  verdict.judge(left_out / offered, kFewLeftOut, kMostLeftOut,
                formatted("%.0f of %.0f views do not fit the others", left_out, offered) +
                    ": look at their reasons and take them again");
  return verdict;
}

}  // namespace cortshift_stereo
