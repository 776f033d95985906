// Stereo pairs from topics to surfaces in pMR space.
#pragma once

#include <cortshift_msgs/AveragePairs.h>
#include <cortshift_msgs/MicroscopeSettings.h>
#include <cortshift_msgs/SurfaceStatus.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/callback_queue.h>
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

#include "cortshift_stereo/admission/pair_synchroniser.hpp"
#include "cortshift_stereo/averaging/frame_collector.hpp"
#include "cortshift_stereo/ros/clock_watch.hpp"
#include "cortshift_stereo/ros/pose_lookup.hpp"
#include "cortshift_stereo/ros/reconstruction/pair_reconstruction.hpp"
#include "cortshift_stereo/ros/reconstruction/surface_demand.hpp"
#include "cortshift_stereo/ros/reconstruction/surface_reconstruction_parameters.hpp"
#include "cortshift_stereo/ros/stamped_history.hpp"

namespace cortshift_stereo {

/// Parameters: SurfaceReconstructionParameters, as private parameters of the node.
/// Subscribes: stereo/{left,right}/image_raw and .../image_raw/compressed, stereo/{left,right}/camera_info,
///   microscope/settings, /tf, /tf_static, surface/wanted (Header with the stamp of the surface that somebody took
///   last, zero: none; he is ready for the next, see SurfaceDemand).
/// Publishes: surface/points (PointCloud2, organised like the rectified left image, frame `map_frame`, stamp of the
///   pair), surface/status (SurfaceStatus, before those points: their warnings), surface/disparity (DisparityImage),
///   /diagnostics with the status "surface".
/// Services: ~average_pairs (the mean of several coming pairs of one view).
///
/// The newest complete pair is worked on by a thread of its own; pairs that a newer one overtakes, also while
/// nobody waits for a surface, are counted. A pair
/// that gives no surface is dropped with its reason in log and diagnostics, and the node goes on.
class SurfaceReconstruction {
 public:
  /// @throws CalibrationError if settings_calibration cannot be used
  SurfaceReconstruction(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                        const SurfaceReconstructionParameters& parameters);
  ~SurfaceReconstruction();

  SurfaceReconstruction(const SurfaceReconstruction&) = delete;
  SurfaceReconstruction& operator=(const SurfaceReconstruction&) = delete;

 private:
  using Synchroniser = PairSynchroniser<ImageMessage>;
  using Side = Synchroniser::Side;

  struct Drop {
    DropReason why;
    ros::Time stamp;
  };

  template <typename Message>
  ros::Subscriber subscribe(const std::string& topic, Side side);
  void receive(Side side, const ros::Time& stamp, const ImageMessage& image);
  void reportUnpaired();

  void work();
  void process(const Synchroniser::Pair& pair, const ros::Time& stamp);
  /// Pair and what is known of cameras and microscope by now.
  PairMessages gather(const Synchroniser::Pair& pair, const ros::Time& stamp);
  /// Puts in what is in force at the stamp as far as it has come. With input_mutex_ held.
  /// @return whether that says something else than what was there
  bool refresh(PairMessages& messages) const;
  /// The surface under the calibration and setting in force at the time of the pair. They travel on topics of their own
  /// and may arrive after the pair: what was made or refused under older ones is done again.
  PairSurface reconstruct(PairMessages messages, const PoseSource& poses);
  ros::Time receivedAt(const ros::Time& stamp);  ///< when the later image of a pair came in; zero: not known any more
  cortshift_msgs::SurfaceStatus statusOf(const std_msgs::Header& header, const std::vector<std::string>& warnings);
  void requireOneContent(const ros::Time& stamp);
  bool averagePairs(cortshift_msgs::AveragePairs::Request& request, cortshift_msgs::AveragePairs::Response& response);

  void drop(const DropReason& why, const ros::Time& stamp);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);
  void publishDiagnostics();

  SurfaceReconstructionParameters parameters_;
  ros::CallbackQueue data_queue_;
  ros::NodeHandle node_;  // its callbacks go there
  PoseLookup poses_;

  std::mutex input_mutex_;
  std::condition_variable input_arrived_;
  Synchroniser synchroniser_;
  std::optional<Synchroniser::Pair> newest_;
  SurfaceDemand demand_;
  StampedHistory<sensor_msgs::CameraInfo> infos_[2];
  StampedHistory<cortshift_msgs::MicroscopeSettings> settings_;
  struct Received {
    ImageMessage image;  // raw and compressed of one stamp together
    ros::Time time;
  };
  std::map<ros::Time, Received> images_[2];  // the last few
  bool stop_ = false;

  PairReconstruction reconstruction_;  // worker thread only
  FrameCollector collector_;

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
  std::vector<std::string> last_warnings_;
  ClockWatch clock_;
  std::string calibrated_settings_;

  ros::CallbackQueue service_queue_;
  ros::ServiceServer average_service_;
  ros::AsyncSpinner data_spinner_, service_spinner_;
  ros::Publisher points_publisher_;
  ros::Publisher status_publisher_;
  ros::Publisher disparity_publisher_;
  std::vector<ros::Subscriber> subscribers_;
  std::mutex updater_mutex_;
  diagnostic_updater::Updater updater_;
  ros::WallTimer unpaired_timer_;
  ros::WallTimer diagnostics_timer_;
  std::thread worker_;
};

}  // namespace cortshift_stereo
