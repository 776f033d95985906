// Whether a hand-eye calibration can be used.
#pragma once

#include "cortshift_stereo/calibration/calibration_verdict.hpp"
#include "cortshift_stereo/calibration/hand_eye/hand_eye.hpp"

namespace cortshift_stereo {

CalibrationVerdict judgeHandEye(const HandEyeCalibration& calibration);

}  // namespace cortshift_stereo
