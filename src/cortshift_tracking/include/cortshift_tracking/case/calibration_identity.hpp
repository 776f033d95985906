// Which calibration a stage was taken with: what must not change within a case unnoticed.
#pragma once

#include <cortshift_msgs/StageInfo.h>

#include <string>

#include "cortshift_tracking/case/stage_store.hpp"

namespace cortshift_tracking {

/// SHA-256 of both camera_infos and of the stereo and the hand-eye edge, rounded to a micrometre and a microradian:
/// what is repeated in text or float is the same. Empty where some of them is not known. The setting of the microscope
/// is no part of it: it may change freely where it is calibrated.
std::string calibrationOf(const StageRecord& record);

/// The one of both stages; of two the two, with a comma in between. One that is not known is left out.
std::string calibrationOf(const cortshift_msgs::StageInfo& from, const cortshift_msgs::StageInfo& to);

/// Two of which one is not known are the same: nothing tells them apart.
bool sameCalibration(const cortshift_msgs::StageInfo& a, const cortshift_msgs::StageInfo& b);

}  // namespace cortshift_tracking
