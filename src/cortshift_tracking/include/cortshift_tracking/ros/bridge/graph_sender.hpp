// What the graph measures, to every OpenIGTLink peer.
#pragma once

#include <cortshift_msgs/DisplacementField.h>
#include <cortshift_msgs/UpdatedMr.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include <string>
#include <vector>

#include "cortshift_tracking/igtl/endpoint.hpp"
#include "cortshift_tracking/igtl/mesh.hpp"
#include "cortshift_tracking/ros/bridge/bridge_parameters.hpp"

namespace cortshift_tracking::igt {

/// Subscribes /shift/field, /surface/points, /shift/overlay_before, /shift/overlay_after, /shift/magnitude,
/// /brain_model/updated_mr, /brain_model/overlay. Sends POLYDATA ShiftField, Surface, Now_LABEL; IMAGE FieldTexture,
/// UpdatedMr and the pictures; STRING ShiftSummary; NDARRAY ShiftSummaryValues.
class GraphSender {
 public:
  /// @param parameters, space, endpoint  outlive this
  GraphSender(ros::NodeHandle& node, const BridgeParameters& parameters, const LinkSpace& space, Endpoint& endpoint);

 private:
  void onField(const cortshift_msgs::DisplacementField::ConstPtr& field);
  void onUpdatedMr(const cortshift_msgs::UpdatedMr::ConstPtr& mr);
  void onSurface(const sensor_msgs::PointCloud2::ConstPtr& cloud);
  void onPicture(const std::string& device, const sensor_msgs::Image::ConstPtr& image);
  ros::Subscriber subscribePicture(ros::NodeHandle& node, const std::string& topic, const std::string& device);
  void writeField(const cortshift_msgs::DisplacementField& field, const PointGrid& grid) const;
  void publish(const std::string& topic, Bytes bytes);

  const BridgeParameters& parameters_;
  const LinkSpace& space_;
  Endpoint& endpoint_;
  ros::WallTime last_surface_;
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace cortshift_tracking::igt
