#include "cortshift_stereo/admission/checks.hpp"

#include <stdexcept>

#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/admission/limits.hpp"
#include "cortshift_stereo/admission/pair_quality.hpp"

namespace cortshift_stereo {
namespace {

std::string number(double value) { return cortshift_flow::formatted("%.4g", value); }

const char* const kPairDoors = "reconstruction, process_bag, recompute, reconstruct_pair";
const char* const kRigDoors = "reconstruction, process_bag, recompute, validate_bag";
const char* const kCaptureDoors = "shift_tracker, process_bag, validate_bag";

}  // namespace

Check checkOf(CheckId id) {
  const PairLimits pair;
  const PoseLimits pose;
  switch (id) {
    case CheckId::kImageMessage:
      return {"image", "an image message", "decodable, of an encoding that is understood; else refused", "",
              kPairDoors};
    case CheckId::kBitDepth:
      return {"bit_depth", "bits used in images of 16 bits, over both cameras and the case",
              "10 to 16, alike in both cameras, or as declared; else refused", "image_bits", kPairDoors};
    case CheckId::kImageSize:
      return {"image_size", "size of the image", "that of its calibration; else refused", "", kPairDoors};
    case CheckId::kBlank:
      return {"blank", "standard deviation of the luminance",
              "at least " + number(pair.min_contrast) + " grey levels; else refused", "min_contrast", kPairDoors};
    case CheckId::kSaturated:
      return {"saturated", "share of saturated pixels",
              "at most " + number(100 * pair.max_saturated_share) + " %; else refused", "max_saturated_share",
              kPairDoors};
    case CheckId::kDefocused:
      return {"defocused", "fine detail over coarse detail in the middle of the image",
              "at least " + number(pair.min_sharpness) +
                  ", and the detail of the two images alike within a factor of " + number(pair.max_sharpness_ratio) +
                  "; else refused",
              "min_sharpness, max_sharpness_ratio", kPairDoors};
    case CheckId::kRawAndCompressed:
      return {"raw_and_compressed", "a raw and a compressed image of one camera and stamp",
              "the same content but for the losses of JPEG; else refused", "", "reconstruction, process_bag"};
    case CheckId::kUnsynchronised:
      return {"unsynchronised", "stamps of the two images", "not further apart than sync_tolerance; else refused",
              "sync_tolerance", kRigDoors};
    case CheckId::kNoStamp:
      return {"no_stamp", "stamp of the pair", "set; zero is refused", "", kRigDoors};
    case CheckId::kSwapped:
      return {"swapped", "vertical gap between matched points, as it is and with the images exchanged",
              "not plainly better exchanged; else refused", "", kPairDoors};
    case CheckId::kEpipolar:
      return {"epipolar", "vertical gaps between matched points, as a motion of the right camera",
              "gaps of a turn are taken out up to " + number(pair.max_misalignment) +
                  " px and warned of, beyond refused; what scatters about it at most " +
                  number(pair.max_epipolar_residual) + " px, else refused",
              "max_misalignment, max_epipolar_residual", kPairDoors};
    case CheckId::kCoverage:
      return {"coverage", "share of the image with a point",
              "at least " + number(100 * pair.min_coverage) + " %; else refused", "min_coverage", kPairDoors};
    case CheckId::kNoMatch:
      return {"no_match", "points found in both images", "enough to trust the pair; else refused", "", kPairDoors};
    case CheckId::kCameraInfo:
      return {"camera_info", "camera_info of both cameras", "heard; else refused", "calibration_timeout", kRigDoors};
    case CheckId::kCalibration:
      return {"calibration", "camera_info and the deformation fields of settings", "a calibration; else refused", "",
              kPairDoors};
    case CheckId::kStereoEdge:
      return {"stereo_edge", "left_optical -> right_optical of tf against camera_info (P[3], R)",
              "not further apart than " + number(1e3 * StereoEdgeLimits::kPlace) + " mm and " +
                  number(1e3 * StereoEdgeLimits::kRotation) + " mrad; else refused",
              "", kRigDoors};
    case CheckId::kSettings:
      return {"settings", "setting of the microscope", "one that is calibrated; else refused",
              "settings_calibration, settings_tolerance", kRigDoors};
    case CheckId::kSettingUnknown:
      return {"setting_unknown", "/microscope/settings",
              "heard; else refused where a settings calibration is in use, warned of where there is none",
              "settings_calibration", kRigDoors};
    case CheckId::kPose:
      return {"pose", "pose of the camera at the exposure",
              "samples of every moving edge on either side within max_pose_gap; else refused", "max_pose_gap",
              kRigDoors};
    case CheckId::kPoseSources:
      return {"pose_sources",
              "one edge of tf that is both fixed and moving, fixed twice, has two poses of one stamp, or two parents",
              "one source, or the same from both; else refused", "", kRigDoors};
    case CheckId::kPosePublishers:
      return {"pose_publishers", "samples of one edge around the exposure", "no two interleaved series; else refused",
              "", kRigDoors};
    case CheckId::kPoseJitter:
      return {"pose_jitter", "deviation of the samples around the exposure from steady motion, where the camera looks",
              "at most " + number(1e3 * pose.tracker_jitter) + " mm root mean square; up to " +
                  number(PoseLimits::kRefusedJitter) + " times that warned of, beyond refused",
              "tracker_jitter", kRigDoors};
    case CheckId::kPoseRepeated:
      return {"pose_repeated", "samples of a moving edge, bit by bit",
              "no more of them as before in a row than its own rounding explains; else refused", "", kRigDoors};
    case CheckId::kPoseStuck:
      return {"pose_stuck", "poses that stay the same bit by bit, and the images meanwhile",
              "surroundings in the image that stand still as well; else refused", "", "reconstruction, process_bag"};
    case CheckId::kImageRepeated:
      return {"image_repeated", "the left image, bit by bit, and the poses meanwhile",
              "another image where the camera has moved; else refused", "", "reconstruction, process_bag"};
    case CheckId::kPoseMotion:
      return {"pose_motion", "speed of the camera at the exposure", "at most max_speed; else refused", "max_speed",
              kCaptureDoors};
    case CheckId::kRecordTime:
      return {"record_time", "stamp of a pair against the time that it was recorded, or came in, at",
              "less than a period of the pairs or " + number(ClockLimits::kTransport) +
                  " s apart, in a running graph " + number(ClockLimits::kLive) + " s; else warned of",
              "", "reconstruction, process_bag, validate_bag"};
    case CheckId::kTrackerClock:
      return {"tracker_clock", "stamps of a moving edge against when they came in, beside those of the pair",
              "not ahead by more than " + number(ClockLimits::kAhead) + " s; else refused", "", "reconstruction"};
    case CheckId::kAbsurdStamp:
      return {"absurd_stamp", "record time of a message against that of the others",
              "within the recording; else left out and said", "", "process_bag, validate_bag"};
    case CheckId::kSimTime:
      return {"sim_time", "use_sim_time and /clock", "a clock that runs; else warned of", "use_sim_time",
              "reconstruction, shift_tracker"};
    case CheckId::kDeviceClock:
      return {"device_clock", "a camera's clock against the computer's",
              "no jump; else its map begins anew and it is said", "", "driver"};
    case CheckId::kRegistrationUnsettled:
      return {"unsettled", "time since registration or calibration last changed",
              "long enough for every node to hear of it; else refused", "", "shift_tracker, process_bag"};
    case CheckId::kEpoch:
      return {"epoch", "patient registration, camera_info, hand-eye and stereo edge of two stages",
              "the same; else compute_shift refuses and compute_shift_across_epochs warns", "",
              "shift_tracker, process_bag, recompute"};
    case CheckId::kOtherPair:
      return {"other_pair", "exposure of the captured pair against the time that was asked for",
              "not later by more than max_surface_age; else warned of", "max_surface_age",
              "shift_tracker, process_bag"};
    case CheckId::kNotUnderstood:
      return {"not_understood", "topics of a recording", "listed where nothing that is understood was heard", "",
              "process_bag, validate_bag"};
    case CheckId::kStatus:
      return {"status", "/surface/status of the captured surface", "heard; else warned of", "", "shift_tracker"};
    case CheckId::kCount:
      break;
  }
  throw std::logic_error("checkOf: not a check");
}

std::string checksAsMarkdown() {
  std::string table =
      "# Checks\n\nWhat is known of the input is judged once, in `cortshift_stereo/admission`, for every door. Written "
      "by `rosrun\ncortshift_stereo list_checks`; a test compares it.\n\n"
      "| check | looks at | accepted | parameter | acts in |\n| --- | --- | --- | --- | --- |\n";
  for (int i = 0; i < static_cast<int>(CheckId::kCount); ++i) {
    const Check check = checkOf(static_cast<CheckId>(i));
    const std::string parameter = check.parameter.empty() ? "" : "`" + check.parameter + "`";
    table += "| `" + check.word + "` | " + check.looks_at + " | " + check.limit + " | " + parameter + " | " +
             check.acts + " |\n";
  }
  return table;
}

}  // namespace cortshift_stereo
