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

#include "cortshift_stereo/frame_average.hpp"
#include "cortshift_stereo/ros/pose_tree.hpp"
#include "cortshift_stereo/ros/surface_reconstruction_parameters.hpp"

namespace cortshift_stereo {

/// One of the two is set.
struct ImageMessage {
  sensor_msgs::ImageConstPtr raw;
  sensor_msgs::CompressedImageConstPtr compressed;
};

struct PairMessages {
  ros::Time stamp;
  ImageMessage left, right;
  sensor_msgs::CameraInfoConstPtr left_info, right_info;  ///< null: none has come
  cortshift_msgs::MicroscopeSettingsConstPtr settings;    ///< null: none has come, which means the reference setting
};

struct PairSurface {
  Surface surface_map;  ///< in the map frame (pmr)
  ReconstructionResult result;
  std::shared_ptr<const Rectifier> rectifier;
  std::size_t averaged = 1;  ///< pairs that the surface is the mean of
};

/// Whether the two say the same of the camera, whatever their headers.
bool sameCalibration(const sensor_msgs::CameraInfo& a, const sensor_msgs::CameraInfo& b);

/// Why a pair gave no surface: a short fixed word for counting, and a sentence for people.
struct DropReason {
  std::string reason;
  std::string message;
};
DropReason dropReason(const std::exception& error);

/// Pairs in the order of their stamps, each to a surface. Keeps the rectification of an unchanged calibration, the
/// setting that it belongs to, and what is averaged. Not synchronised.
class PairReconstruction {
 public:
  explicit PairReconstruction(const SurfaceReconstructionParameters& parameters) : parameters_(parameters) {}

  /// @param pose_at  asked once, after the reconstruction: the tracker's next sample may still be under way
  /// @throws PairError, MessageError, CalibrationError, PoseError; see dropReason
  PairSurface operator()(const PairMessages& pair, const PoseAt& pose_at);

  /// Calibration and settings alone; the images may be missing. @throws PairError, CalibrationError
  void check(const PairMessages& pair);

 private:
  struct PastFrame {
    ros::Time stamp;
    Eigen::Isometry3d T_map_left;
    std::shared_ptr<const Rectifier> rectifier;
    Frame frame;
  };

  void prepareRectifier(const PairMessages& pair);
  void checkSettings(const PairMessages& pair);
  /// Mean of this pair and the ones before it that show the same view; returns their number.
  std::size_t average(const ros::Time& stamp, const Eigen::Isometry3d& T_map_left, ReconstructionResult& result);

  SurfaceReconstructionParameters parameters_;
  std::vector<PastFrame> past_;
  sensor_msgs::CameraInfoConstPtr left_info_, right_info_;  // of rectifier_
  std::shared_ptr<const Rectifier> rectifier_;
  std::optional<MicroscopeSetting> calibrated_setting_;  // of that calibration
};

}  // namespace cortshift_stereo
