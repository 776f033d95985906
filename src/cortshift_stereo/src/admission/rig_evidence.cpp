#include "cortshift_stereo/admission/rig_evidence.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "cortshift_stereo/admission/limits.hpp"

namespace cortshift_stereo {
namespace {

Eigen::Matrix3d eigen(const cv::Matx33d& R) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.val);
}

}  // namespace

Findings checkStereoEdge(const StereoModel& model, const Eigen::Isometry3d& T_left_right) {
  Findings found;
  // Rectification turns both cameras into one orientation; the right one then lies along x.
  const Eigen::Matrix3d R_left = eigen(model.left.R), R_right = eigen(model.right.R);
  const Eigen::Matrix3d difference = (R_left.transpose() * R_right).transpose() * T_left_right.linear();
  const double angle = Eigen::AngleAxisd(difference).angle();
  const double offset = (R_left * T_left_right.translation() - Eigen::Vector3d(model.baseline(), 0, 0)).norm();
  if (angle <= StereoEdgeLimits::kRotation && offset <= StereoEdgeLimits::kPlace) return found;
  char text[160];
  std::snprintf(text, sizeof text,
                "differ about the stereo head by %.2f deg and %.2f mm (baseline %.2f mm in tf, %.2f mm in P[3])",
                angle * 180 / M_PI, 1e3 * offset, 1e3 * T_left_right.translation().norm(), 1e3 * model.baseline());
  found.refuse(
      CheckId::kStereoEdge, "tf and camera_info", text,
      "they are not of one calibration; publish left_optical -> right_optical and camera_info from the same one");
  return found;
}

Findings checkSettingKnown(const std::optional<MicroscopeSetting>& said, bool several) {
  Findings found;
  if (said && said->possible()) return found;
  const std::string thing = "The microscope's setting";
  const std::string remedy =
      "publish or record /microscope/settings, which is latched and stands in the first part of a split recording";
  const std::string unknown = "is not known (" + (said ? describe(*said) : "nothing") + " on /microscope/settings)";
  if (several)
    found.refuse(CheckId::kSettingUnknown, thing, unknown + ", and the calibration in use knows several", remedy);
  else
    found.warn(CheckId::kSettingUnknown, thing, unknown + "; that of the calibration is assumed", remedy);
  return found;
}

Findings checkTrackerClock(const std::string& edge, std::vector<double> lags, double pair_lag) {
  Findings found;
  const auto middle = lags.begin() + static_cast<std::ptrdiff_t>(lags.size() / 2);
  std::nth_element(lags.begin(), middle, lags.end());
  if (*middle >= std::min(0.0, pair_lag) - ClockLimits::kAhead) return found;
  char text[120];
  std::snprintf(text, sizeof text, "come in %.3f s before the time that they are stamped with", -*middle);
  found.refuse(CheckId::kTrackerClock, "The samples of " + edge, text,
               "nothing is measured before its time: set the clocks of cameras and tracker by one source");
  return found;
}

Findings checkLag(const std::string& thing, double lag, double most, const std::string& clock) {
  Findings found;
  if (lag <= most && lag >= -most) return found;
  char text[120];
  std::snprintf(text, sizeof text, "lies %.3f s %s its %s (allowed: %.3f s)", std::abs(lag),
                lag > 0 ? "behind" : "ahead of", clock.c_str(), most);
  found.warn(
      CheckId::kRecordTime, thing, text,
      "set the clocks of cameras, tracker and recorder by one source; times given to a tool count in record time");
  return found;
}

Findings checkWait(double late, double most) {
  Findings found;
  if (late <= most) return found;
  char text[120];
  std::snprintf(text, sizeof text, "was exposed %.1f s after the time that was asked for (expected: within %.1f s)",
                late, most);
  found.warn(CheckId::kOtherPair, "The captured pair", text,
             "see why the pairs before it gave no surface, and whether this one still shows the stage that is meant");
  return found;
}

Findings checkStamp(int64_t stamp_ns) {
  Findings found;
  if (stamp_ns == 0)
    found.refuse(CheckId::kNoStamp, "The pair", "has no stamp (0)",
                 "let the driver write the time of the exposure into both headers");
  return found;
}

}  // namespace cortshift_stereo
