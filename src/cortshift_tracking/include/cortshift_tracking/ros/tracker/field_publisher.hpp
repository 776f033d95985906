// Fields and their pictures on the topics that everyone listens to.
#pragma once

#include <cortshift_msgs/StageInfo.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>

#include "cortshift_tracking/ros/parameters.hpp"
#include "cortshift_tracking/shift.hpp"

namespace cortshift_tracking {

/// Parameters: arrow_spacing [m], own_points
/// Publishes (latched):
///   /shift/field [cortshift_msgs/DisplacementField], /shift/points [sensor_msgs/PointCloud2]
///   /shift/markers [visualization_msgs/MarkerArray]
///   /shift/outline, /shift/overlay_before, /shift/overlay_after, /shift/magnitude, /shift/gravity, /shift/normal,
///   /shift/lateral [sensor_msgs/Image] bgr8; gravity only where it is known
///   /shift/own_points [sensor_msgs/PointCloud2] with own_points: displacements of the earlier surface's own points
/// A field that was asked for comes last, when everything that shows it is there; a live one at once.
class FieldPublisher {
 public:
  FieldPublisher(const ShiftTrackerParameters& parameters, ros::NodeHandle& node);

  /// @param directions  what the summary was measured against
  /// @param live  pictures, arrows and own points that nobody looks at are left out
  void publish(const ShiftResult& result, const Directions& directions, const cortshift_msgs::StageInfo& from,
               const cortshift_msgs::StageInfo& to, bool live);

 private:
  const double arrow_spacing_;  // [m]
  const bool with_own_points_;
  ros::Publisher field_, points_, markers_, outline_, overlay_before_, overlay_after_, magnitude_, gravity_, normal_,
      lateral_, own_points_;
};

}  // namespace cortshift_tracking
