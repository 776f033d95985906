#include "cortshift_tracking/ros/recording/sequence_watch.hpp"

#include <sstream>
#include <vector>

namespace cortshift_tracking {
namespace {

/// Whether the first field of a message of this definition is a std_msgs/Header.
bool beginsWithHeader(const std::string& definition) {
  std::istringstream lines(definition);
  std::string line;
  while (std::getline(lines, line)) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::string type, name;
    if (words >> type >> name) return (type == "Header" || type == "std_msgs/Header") && name == "header";
  }
  return false;
}

/// The sequence number, which stands first in a header.
std::uint32_t numberOf(const topic_tools::ShapeShifter& message) {
  std::vector<std::uint8_t> bytes(message.size());
  ros::serialization::OStream out(bytes.data(), message.size());
  message.write(out);
  return bytes[0] | bytes[1] << 8 | bytes[2] << 16 | static_cast<std::uint32_t>(bytes[3]) << 24;
}

}  // namespace

std::uint64_t SequenceWatch::missingBefore(const Recorded& message) {
  const auto [place, is_new] = last_.try_emplace({message.topic, message.said("callerid")});
  Last& last = place->second;
  if (is_new) last.numbered = beginsWithHeader(message.message->getMessageDefinition());
  if (!last.numbered || message.message->size() < sizeof(std::uint32_t)) return 0;
  const std::uint32_t number = numberOf(*message.message);
  const std::uint64_t missing = !is_new && number > last.number ? number - last.number - 1 : 0;
  last.number = number;
  return missing;
}

}  // namespace cortshift_tracking
