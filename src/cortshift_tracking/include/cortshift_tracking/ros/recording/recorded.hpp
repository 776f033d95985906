#pragma once

#include <ros/datatypes.h>
#include <ros/time.h>
#include <topic_tools/shape_shifter.h>

#include <memory>
#include <string>

namespace cortshift_tracking {

/// A message of any type as it arrived.
struct Recorded {
  std::string topic;
  ros::Time time;  ///< of arrival
  boost::shared_ptr<const topic_tools::ShapeShifter> message;
  boost::shared_ptr<ros::M_string> connection;  ///< header of the connection: callerid, latching, ...

  /// A value of the connection's header, empty where it has none.
  std::string said(const std::string& name) const {
    const auto found = connection ? connection->find(name) : ros::M_string::const_iterator();
    return connection && found != connection->end() ? found->second : std::string();
  }
};

}  // namespace cortshift_tracking
