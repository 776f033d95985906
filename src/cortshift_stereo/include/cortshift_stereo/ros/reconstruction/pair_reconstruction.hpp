// The messages of one pair to its surface: the step that a running node and a recorded case share.
#pragma once

#include <cortshift_msgs/MicroscopeSettings.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <Eigen/Geometry>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_stereo/admission/view_memory.hpp"
#include "cortshift_stereo/averaging/view_frames.hpp"
#include "cortshift_stereo/images/bit_depth.hpp"
#include "cortshift_stereo/rectification/rectifier_selector.hpp"
#include "cortshift_stereo/ros/pose_source.hpp"
#include "cortshift_stereo/ros/reconstruction/surface_reconstruction_parameters.hpp"

namespace cortshift_stereo {

/// At least one of the two is set. Both: two sources of one image, which must agree.
struct ImageMessage {
  sensor_msgs::ImageConstPtr raw;
  sensor_msgs::CompressedImageConstPtr compressed;
};

/// @throws PairError where raw and compressed image are both there and not the same, MessageError
void requireOneContent(const ImageMessage& image, const std::string& side);

struct PairMessages {
  ros::Time stamp;
  ImageMessage left, right;
  sensor_msgs::CameraInfoConstPtr left_info, right_info;  ///< null: none has come
  cortshift_msgs::MicroscopeSettingsConstPtr settings;    ///< in force at the stamp; null: none has come
};

/// As the message says it, possible or not.
std::optional<MicroscopeSetting> settingSaid(const PairMessages& pair);

struct PairSurface {
  Surface surface_map;  ///< in the map frame (pmr)
  ReconstructionResult result;
  std::size_t averaged = 1;           ///< pairs that the surface is the mean of
  PosedFrame frame;                   ///< of this pair alone
  std::vector<std::string> warnings;  ///< of all that the surface is the mean of
};

/// Whether the two say the same of the camera, whatever their headers.
bool sameCalibration(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b);

/// Why a pair gave no surface: a short fixed word for counting, and a sentence for people.
struct DropReason {
  std::string reason;
  std::string message;
};
DropReason dropReason(const std::exception& error);

/// Pairs in the order of their stamps, each to a surface. Keeps the rectification of an unchanged calibration and
/// setting, and what is averaged. Not synchronised.
class PairReconstruction {
 public:
  /// @param depth  of the images of 16 bits, where several reconstructions belong to one case
  /// @throws CalibrationError if settings_calibration cannot be used, ImageError if image_bits cannot be
  explicit PairReconstruction(const SurfaceReconstructionParameters& parameters,
                              std::shared_ptr<BitDepth> depth = nullptr);

  /// @param poses  asked once, after the reconstruction: the tracker's next sample may still be under way
  /// @throws PairError, MessageError, CalibrationError, PoseError; see dropReason
  PairSurface operator()(const PairMessages& pair, const PoseSource& poses);

  /// An earlier pair that is not reconstructed: its left image and pose, for what a later one is compared with.
  /// @throws PairError, MessageError, CalibrationError, PoseError
  void remember(const PairMessages& pair, const PoseSource& poses);

  /// The same judgement without the images, which may be missing: what is accepted with a warning.
  /// @throws PairError, CalibrationError, PoseError
  Findings check(const PairMessages& pair, const PoseSource& poses);

  /// Which settings of the microscope can be used, for people.
  std::string calibratedSettings() const { return rectifiers_.calibratedSettings(); }

 private:
  void calibrate(const PairMessages& pair);
  std::shared_ptr<const Rectifier> rectifierFor(const PairMessages& pair);
  Findings judgeKnown(const PairMessages& pair) const;
  Findings judgePose(const PairMessages& pair, const StereoModel& model, const PoseSource& poses) const;

  SurfaceReconstructionParameters parameters_;
  std::shared_ptr<BitDepth> depth_;
  sensor_msgs::CameraInfoConstPtr left_info_, right_info_;  // that rectifiers_ is calibrated with
  std::optional<StereoModel> stereo_;                       // what they say
  RectifierSelector rectifiers_;
  ViewFrames recent_;
  ViewMemory views_;
};

}  // namespace cortshift_stereo
