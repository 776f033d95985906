// Stereo pairs from topics to surfaces in pMR space.
#pragma once

#include <cortshift_msgs/MicroscopeSettings.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "cortshift_stereo/calibration/settings_warp.hpp"
#include "cortshift_stereo/frame_average.hpp"
#include "cortshift_stereo/pair_synchroniser.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "cortshift_stereo/ros/pose_lookup.hpp"

namespace cortshift_stereo {

/// Parameters of the node, each default once. Lengths in metres, times in seconds.
struct SurfaceReconstructionParameters {
  std::string map_frame = "pmr";              ///< frame of the published points
  std::string camera_frame = "left_optical";  ///< raw left optical frame
  double sync_tolerance = 0;                  ///< [s] largest difference of the two stamps of a pair
  double pair_timeout = 0.5;                  ///< [s] wall time that an image waits for its partner
  double max_pose_gap = 0.15;                 ///< [s] farthest tracker sample on either side of the pair's stamp
  double pose_timeout = 1.0;                  ///< [s] wall time to wait for the pose after the pair was matched
  double calibration_timeout = 1.0;           ///< [s] wall time to wait for camera_info
  double reference_magnification = 0;         ///< microscope setting that the calibration belongs to; 0: not known,
                                              ///< the first one seen with a camera_info is taken for it
  double reference_focal_length = 0;          ///< [m] the same
  double settings_tolerance = 0.005;          ///< relative difference that counts as the reference setting
  int average_pairs = 1;                      ///< a surface is the robust mean of up to so many pairs, the newest last
  double average_window = 3.0;                ///< [s] age of the oldest of them
  double average_max_translation = 0.0005;    ///< [m] movement of the camera that ends the mean
  double average_max_rotation = 0.002;        ///< [rad] the same
  ReconstructionSettings reconstruction;

  /// Empty where it is not known.
  std::optional<MicroscopeSetting> referenceSetting() const;

  /// @throws ParameterError
  static SurfaceReconstructionParameters load(const ros::NodeHandle& private_node);
};

/// Parameters: SurfaceReconstructionParameters, as private parameters of the node.
/// Subscribes: stereo/{left,right}/image_raw and .../image_raw/compressed, stereo/{left,right}/camera_info,
///   microscope/settings, /tf, /tf_static.
/// Publishes: surface/points (PointCloud2, organised like the rectified left image, frame `map_frame`, stamp of the
///   pair), surface/disparity (DisparityImage), /diagnostics with the status "surface".
///
/// The newest complete pair is worked on by a thread of its own; pairs that a newer one overtakes are counted. A pair
/// that gives no surface is dropped with its reason in log and diagnostics, and the node goes on.
class SurfaceReconstruction {
 public:
  SurfaceReconstruction(ros::NodeHandle node, const SurfaceReconstructionParameters& parameters);
  ~SurfaceReconstruction();

  SurfaceReconstruction(const SurfaceReconstruction&) = delete;
  SurfaceReconstruction& operator=(const SurfaceReconstruction&) = delete;

 private:
  /// One of the two is set.
  struct Image {
    sensor_msgs::ImageConstPtr raw;
    sensor_msgs::CompressedImageConstPtr compressed;
  };
  using Synchroniser = PairSynchroniser<Image>;
  using Side = Synchroniser::Side;

  struct Drop {
    std::string reason;
    std::string message;
    ros::Time stamp;
  };

  template <typename Message>
  ros::Subscriber subscribe(const std::string& topic, Side side);
  void receive(Side side, const ros::Time& stamp, const Image& image);
  void reportUnpaired();

  void work();
  void process(const Synchroniser::Pair& pair, const ros::Time& stamp);
  std::shared_ptr<const Rectifier> rectifier();
  /// Mean of this pair and the ones before it that show the same view; returns their number.
  std::size_t average(const ros::Time& stamp, const Eigen::Isometry3d& T_pmr_left, ReconstructionResult& result);
  void checkSettings();

  void drop(const std::string& reason, const ros::Time& stamp, const std::string& message);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);
  void publishDiagnostics();

  SurfaceReconstructionParameters parameters_;
  ros::NodeHandle node_;
  PoseLookup poses_;

  std::mutex input_mutex_;
  std::condition_variable input_arrived_;
  Synchroniser synchroniser_;
  std::optional<Synchroniser::Pair> newest_;
  sensor_msgs::CameraInfoConstPtr infos_[2];
  std::optional<cortshift_msgs::MicroscopeSettings> settings_;
  bool stop_ = false;

  // Worker thread only.
  struct PastFrame {
    ros::Time stamp;
    Eigen::Isometry3d T_pmr_left;
    std::shared_ptr<const Rectifier> rectifier;
    Frame frame;
  };
  std::vector<PastFrame> past_;
  sensor_msgs::CameraInfoConstPtr rectifier_infos_[2];
  std::shared_ptr<const Rectifier> rectifier_;
  std::optional<MicroscopeSetting> calibrated_setting_;  // of that calibration

  std::mutex status_mutex_;
  uint64_t pairs_received_ = 0;
  uint64_t pairs_overtaken_ = 0;
  uint64_t surfaces_published_ = 0;
  std::map<std::string, uint64_t> drops_;
  std::optional<Drop> last_drop_;
  bool last_pair_dropped_ = false;
  std::optional<ReconstructionQuality> last_quality_;
  ros::Time last_surface_stamp_;
  double last_seconds_ = 0;
  std::size_t last_averaged_ = 0;

  ros::Publisher points_publisher_;
  ros::Publisher disparity_publisher_;
  std::vector<ros::Subscriber> subscribers_;
  std::mutex updater_mutex_;
  diagnostic_updater::Updater updater_;
  ros::WallTimer unpaired_timer_;
  ros::WallTimer diagnostics_timer_;
  std::thread worker_;
};

}  // namespace cortshift_stereo
