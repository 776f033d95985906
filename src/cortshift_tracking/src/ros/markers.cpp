#include "cortshift_tracking/ros/markers.hpp"

#include <algorithm>
#include <cmath>

#include "cortshift_tracking/field/pictures.hpp"

namespace cortshift_tracking {
namespace {

geometry_msgs::Point toPoint(const cv::Vec3f& v) {
  geometry_msgs::Point point;
  point.x = v[0];
  point.y = v[1];
  point.z = v[2];
  return point;
}

}  // namespace

visualization_msgs::MarkerArray arrowsOf(const DisplacementField& field, const std_msgs::Header& header,
                                         double spacing) {
  visualization_msgs::MarkerArray arrows;
  visualization_msgs::Marker clear;
  clear.header = header;
  clear.action = visualization_msgs::Marker::DELETEALL;
  arrows.markers.push_back(clear);

  const double end = scaleEnd(field);
  const int step = std::max(1, static_cast<int>(std::lround(spacing / field.frame.resolution)));
  for (int row = step / 2; row < field.frame.size.height; row += step)
    for (int column = step / 2; column < field.frame.size.width; column += step) {
      const cv::Vec3f& d = field.displacement_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(d[0])) continue;
      const cv::Vec3f& start = field.start_pmr.at<cv::Vec3f>(row, column);
      const double length = cv::norm(d);
      visualization_msgs::Marker arrow;
      arrow.header = header;
      arrow.ns = "shift";
      arrow.id = static_cast<int>(arrows.markers.size());
      arrow.type = visualization_msgs::Marker::ARROW;
      arrow.pose.orientation.w = 1;
      arrow.points = {toPoint(start), toPoint(start + d)};
      arrow.scale.x = 0.12 * spacing;  // shaft diameter [m]
      arrow.scale.y = 0.3 * spacing;   // head diameter [m]
      arrow.scale.z = std::min(0.35 * length, 0.5 * spacing);
      const cv::Vec3b colour = scaleColour(length / end);
      arrow.color.b = static_cast<float>(colour[0]) / 255.0F;
      arrow.color.g = static_cast<float>(colour[1]) / 255.0F;
      arrow.color.r = static_cast<float>(colour[2]) / 255.0F;
      arrow.color.a = 1;
      arrows.markers.push_back(arrow);
    }
  return arrows;
}

}  // namespace cortshift_tracking
