#include "cortshift_tracking/ros/tracker/field_publisher.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/Image.h>

#include <functional>

#include "cortshift_tracking/field/pictures.hpp"
#include "cortshift_tracking/ros/field_message.hpp"
#include "cortshift_tracking/ros/markers.hpp"

namespace cortshift_tracking {

FieldPublisher::FieldPublisher(const ShiftTrackerParameters& parameters, ros::NodeHandle& node)
    : arrow_spacing_(parameters.arrow_spacing), with_own_points_(parameters.shift.with_own_points) {
  const auto picture = [&](const char* topic) { return node.advertise<sensor_msgs::Image>(topic, 1, true); };
  field_ = node.advertise<cortshift_msgs::DisplacementField>("shift/field", 1, true);
  points_ = node.advertise<sensor_msgs::PointCloud2>("shift/points", 1, true);
  markers_ = node.advertise<visualization_msgs::MarkerArray>("shift/markers", 1, true);
  outline_ = picture("shift/outline");
  overlay_before_ = picture("shift/overlay_before");
  overlay_after_ = picture("shift/overlay_after");
  magnitude_ = picture("shift/magnitude");
  gravity_ = picture("shift/gravity");
  normal_ = picture("shift/normal");
  lateral_ = picture("shift/lateral");
  if (with_own_points_) own_points_ = node.advertise<sensor_msgs::PointCloud2>("shift/own_points", 1, true);
}

void FieldPublisher::publish(const ShiftResult& result, const Directions& directions,
                             const cortshift_msgs::StageInfo& from, const cortshift_msgs::StageInfo& to, bool live) {
  cortshift_msgs::DisplacementField field = toMessage(result.field, result.summary, from, to);
  if (live) {  // at once; a field that was asked for comes when everything that shows it is there
    field.summary.latency = (ros::Time::now() - to.stamp).toSec();
    field_.publish(field);
  }
  const auto wanted = [&](const ros::Publisher& publisher) { return !live || publisher.getNumSubscribers() > 0; };
  points_.publish(field.points);
  if (wanted(markers_)) markers_.publish(arrowsOf(result.field, field.header, arrow_spacing_));
  const auto picture = [&](const ros::Publisher& publisher, const std::function<cv::Mat()>& draw) {
    if (wanted(publisher)) publisher.publish(cv_bridge::CvImage(field.header, "bgr8", draw()).toImageMsg());
  };
  picture(outline_, [&] { return brainOutline(result); });
  picture(overlay_before_, [&] { return overlayBefore(result); });
  picture(overlay_after_, [&] { return overlayAfter(result); });
  picture(magnitude_, [&] { return magnitudeMap(result.field); });
  if (directions.gravity_pmr) picture(gravity_, [&] { return gravityMap(result.field, *directions.gravity_pmr); });
  picture(normal_, [&] { return normalMap(result.field, directions.first_normal_pmr); });
  picture(lateral_, [&] { return lateralMap(result.field, directions.first_normal_pmr); });
  if (with_own_points_ && wanted(own_points_)) own_points_.publish(ownPointsMessage(result, field.header));
  if (!live) field_.publish(field);
}

}  // namespace cortshift_tracking
