// The patient registration (reference in pmr): what stages of one epoch have in common.
#pragma once

#include <cortshift_msgs/StageInfo.h>
#include <tf2_msgs/TFMessage.h>

#include <cstdint>
#include <optional>
#include <vector>

namespace cortshift_tracking {

/// A pose of which nothing is known: all NaN.
geometry_msgs::Pose unknownPose();

/// The registration among a stage's fixed transforms; all NaN where there is none.
geometry_msgs::Pose registrationOf(const tf2_msgs::TFMessage& fixed);

/// Two unknown registrations are the same: nothing tells them apart.
bool sameRegistration(const geometry_msgs::Pose& a, const geometry_msgs::Pose& b);

/// Number of the epoch that a new stage belongs to: that of an earlier stage with the same registration and
/// calibration, or the next one; 0 where the registration is not known.
std::uint32_t epochOf(const cortshift_msgs::StageInfo& stage, const std::vector<cortshift_msgs::StageInfo>& earlier);

/// @param changed  when the registration last became another one
/// @throws TrackingError for a pair that was exposed before that or so shortly after it that the reconstruction may not
///   have heard of it
void requireSettled(const ros::Time& stamp, const ros::Time& changed);

/// The registration as it is heard of, in order.
class RegistrationHistory {
 public:
  /// Messages of other edges do not matter. @returns whether the registration became another one
  bool add(const tf2_msgs::TFMessage& message, const ros::Time& time);

  /// All NaN where none has been heard of.
  geometry_msgs::Pose newest() const;

  /// When it last became another one; nothing where it never did.
  std::optional<ros::Time> changed() const { return changed_; }

 private:
  std::optional<geometry_msgs::Pose> newest_;
  std::optional<ros::Time> changed_;
};

}  // namespace cortshift_tracking
