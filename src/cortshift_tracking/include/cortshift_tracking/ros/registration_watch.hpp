// The patient registration as the running graph says it.
#pragma once

#include <mutex>

#include "cortshift_tracking/case/patient_registration.hpp"

namespace cortshift_tracking {

/// Notices when the registration changes, so that no stage mixes two of them. Thread-safe.
class RegistrationWatch {
 public:
  void add(const tf2_msgs::TFMessage& message);

  /// The newest one; all NaN where none has been heard of.
  geometry_msgs::Pose newest() const;

  /// As the function of that name, against the newest change. @throws TrackingError
  void requireSettled(const ros::Time& stamp) const;

 private:
  mutable std::mutex mutex_;
  RegistrationHistory history_;
};

}  // namespace cortshift_tracking
