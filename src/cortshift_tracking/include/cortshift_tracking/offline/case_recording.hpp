// The messages of a recorded case by their contract: pairs, calibration, settings and poses at an instant.
#pragma once

#include <geometry_msgs/TransformStamped.h>

#include <string>
#include <vector>

#include "cortshift_stereo/ros/reconstruction/pair_reconstruction.hpp"
#include "cortshift_stereo/ros/reconstruction/surface_reconstruction_parameters.hpp"
#include "cortshift_tracking/offline/bag/bag_file.hpp"

namespace cortshift_tracking {

/// Where the two images of a pair lie.
struct PairPlace {
  ros::Time stamp;    ///< exposure
  ros::Time arrival;  ///< when the later of the two was recorded
  BagEntry left, right;
};

/// Finds by the index and reads only what is asked for. Not synchronised.
class CaseRecording {
 public:
  /// @param static_tf  fixed edges that the bag lacks
  /// @throws TrackingError for a bag that cannot be used
  CaseRecording(const std::string& path, const cortshift_stereo::SurfaceReconstructionParameters& parameters,
                const std::vector<geometry_msgs::TransformStamped>& static_tf = {});

  const BagFile& bag() const { return bag_; }

  /// Times of the first and the last message. One absurd record time (a clock that was not set) does not count, and is
  /// said in remarks(). @throws TrackingError for a bag without messages
  ros::Time begin() const { return begin_; }
  ros::Time end() const { return end_; }

  /// What is odd about the recording as a whole and was worked around.
  const std::vector<std::string>& remarks() const { return remarks_; }

  /// Topics of images that are recorded and not understood, for people; empty: none.
  std::string notUnderstood() const;

  /// Images recorded within (from, to] that have no partner, each with the reason.
  std::vector<std::string> unpaired(const ros::Time& from, const ros::Time& to) const;

  /// What the clocks say of a pair: its stamp against its record time.
  cortshift_stereo::Findings judgeClock(const PairPlace& pair) const;

  /// Pairs whose later image was recorded within (from, to], in order of arrival.
  std::vector<PairPlace> pairs(const ros::Time& from, const ros::Time& to) const;

  /// The first pair of the recording's first minute.
  std::optional<PairPlace> firstPair() const;

  /// What a node would have known of calibration and settings by then; without the images.
  cortshift_stereo::PairMessages known(const PairPlace& pair) const;

  /// The pair with the calibration and the settings that a node would have known by then.
  cortshift_stereo::PairMessages read(const PairPlace& pair) const;

  /// The setting that the pair's calibration belongs to where none is configured: as in the node, the first one seen
  /// with that calibration. Empty where the bag says nothing of settings.
  std::optional<cortshift_stereo::MicroscopeSetting> referenceSetting(const cortshift_stereo::PairMessages& pair) const;

  /// Poses from what was recorded around a time. It keeps these samples and refers to this recording.
  /// @param max_pose_gap [s]
  cortshift_stereo::PoseSource posesAround(const ros::Time& arrival, double max_pose_gap) const;

  /// The same for all that was recorded within [from, to], which must not be longer than half a minute.
  cortshift_stereo::PoseSource posesWithin(const ros::Time& from, const ros::Time& to, double max_pose_gap) const;

  /// When a fixed edge of tf next becomes another one.
  std::optional<ros::Time> fixedEdgeChangesAfter(const ros::Time& time) const;

  /// When the patient registration became another one, for the last time up to `time`.
  std::optional<ros::Time> registrationChanged(const ros::Time& time) const;

  static const std::vector<std::string>& topics();

 private:
  cortshift_stereo::TransformTree transforms(const ros::Time& from, const ros::Time& to, const ros::Time& fixed_until,
                                             double max_pose_gap) const;
  sensor_msgs::CameraInfoConstPtr infoOf(const std::string& topic, const PairPlace& pair) const;
  cortshift_msgs::MicroscopeSettingsConstPtr settingsOf(const ros::Time& stamp, const ros::Time& arrival) const;
  ros::Time calibratedSince(const std::string& topic, const sensor_msgs::CameraInfo& info,
                            const ros::Time& arrival) const;

  void findRange();
  std::vector<PairPlace> synchronise(const ros::Time& from, const ros::Time& to,
                                     std::vector<std::string>* unpaired) const;

  cortshift_stereo::SurfaceReconstructionParameters parameters_;
  BagFile bag_;
  ros::Time begin_, end_;
  std::vector<std::string> remarks_;
  std::vector<geometry_msgs::TransformStamped> given_statics_;

  struct Static {
    ros::Time time;  // when it was recorded
    geometry_msgs::TransformStamped edge;
  };
  std::vector<Static> statics_;  // each change once
};

}  // namespace cortshift_tracking
