// Every check of what comes in, in one table.
#pragma once

#include <string>
#include <vector>

namespace cortshift_stereo {

/// What a finding was found by. In the order of the table.
enum class CheckId {
  // One image
  kImageMessage,
  kBitDepth,
  kImageSize,
  kBlank,
  kSaturated,
  kDefocused,
  kRawAndCompressed,
  // A pair
  kUnsynchronised,
  kNoStamp,
  kSwapped,
  kEpipolar,
  kCoverage,
  kNoMatch,
  // Calibration and setting
  kCameraInfo,
  kCalibration,
  kStereoEdge,
  kSettings,
  kSettingUnknown,
  // Poses
  kPose,
  kPoseSources,
  kPosePublishers,
  kPoseJitter,
  kPoseRepeated,
  kPoseStuck,
  kImageRepeated,
  kPoseMotion,
  // Clocks
  kRecordTime,
  kTrackerClock,
  kAbsurdStamp,
  kSimTime,
  kDeviceClock,
  // A case
  kRegistrationUnsettled,
  kEpoch,
  kOtherPair,
  kNotUnderstood,
  kStatus,
  kCount  // of the above
};

/// One line of the table.
struct Check {
  std::string word;       ///< short and fixed: what drops are counted under
  std::string looks_at;   ///< the evidence
  std::string limit;      ///< of what is accepted, with its verdict beyond
  std::string parameter;  ///< that sets the limit; empty: none
  std::string acts;       ///< the doors that ask it
};

/// Which check an enumerator stands for. @throws std::logic_error for kCount
Check checkOf(CheckId id);

/// The whole table as the Markdown of doc/checks.md.
std::string checksAsMarkdown();

}  // namespace cortshift_stereo
