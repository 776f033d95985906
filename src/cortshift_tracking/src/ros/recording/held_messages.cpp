#include "cortshift_tracking/ros/recording/held_messages.hpp"

#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <tuple>

namespace cortshift_tracking {
namespace {

const std::string kStatic = "/tf_static";

/// [s] Of two publishers that say one static transform within this time, as at the start of a graph, none takes the
/// other's place: both hold, and who reads the recording sees that they contradict. Later, one was published again by
/// another node (a restarted static_transform_publisher has a new name) and is what holds now. Latched messages of
/// publishers that were there before the recorder arrive within some hundredths of a second.
constexpr double kTogether = 0.3;

boost::shared_ptr<const topic_tools::ShapeShifter> shapeOf(const tf2_msgs::TFMessage& message) {
  auto shape = boost::make_shared<topic_tools::ShapeShifter>();
  using Traits = ros::message_traits::MD5Sum<tf2_msgs::TFMessage>;
  shape->morph(Traits::value(), ros::message_traits::datatype(message), ros::message_traits::definition(message), "1");
  std::vector<std::uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream out(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(out, message);
  ros::serialization::IStream in(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  shape->read(in);
  return shape;
}

}  // namespace

HeldMessages::HeldMessages(std::set<std::string> always) : always_(std::move(always)) {}

void HeldMessages::hold(const Place& place, const Recorded& message) { held_[place] = {++count_, message}; }

void HeldMessages::dropReplaced(const std::string& topic, const std::string& caller, const std::string& child,
                                const ros::Time& time) {
  for (auto entry = held_.begin(); entry != held_.end();) {
    const auto& [its_topic, its_caller, its_child] = entry->first;
    const bool replaced = its_topic == topic && its_child == child && its_caller != caller &&
                          (time - entry->second.second.time).toSec() > kTogether;
    entry = replaced ? held_.erase(entry) : std::next(entry);
  }
}

void HeldMessages::keep(const Recorded& message) {
  const std::string caller = message.said("callerid");
  if (message.topic == kStatic && message.message->getDataType() == "tf2_msgs/TFMessage") {
    const tf2_msgs::TFMessageConstPtr edges = message.message->instantiate<tf2_msgs::TFMessage>();
    for (const auto& edge : edges->transforms) {
      Recorded one = message;
      tf2_msgs::TFMessage alone;
      alone.transforms.push_back(edge);
      one.message = shapeOf(alone);
      dropReplaced(message.topic, caller, edge.child_frame_id, message.time);
      hold({message.topic, caller, edge.child_frame_id}, one);
    }
  } else if (message.said("latching") == "1" || always_.count(message.topic) > 0) {
    hold({message.topic, caller, ""}, message);
  }
}

std::vector<Recorded> HeldMessages::at(const ros::Time& time) const {
  std::vector<std::pair<std::uint64_t, Recorded>> ordered;
  for (const auto& [place, entry] : held_) ordered.push_back(entry);
  std::sort(ordered.begin(), ordered.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Recorded> out;
  for (auto& [order, message] : ordered) {
    message.time = time;
    out.push_back(std::move(message));
  }
  return out;
}

}  // namespace cortshift_tracking
