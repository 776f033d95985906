#pragma once

#include <cstdint>
#include <map>
#include <utility>

#include "cortshift_tracking/ros/recording/recorded.hpp"

namespace cortshift_tracking {

/// Notices messages that never arrived, by the sequence numbers that publishers give to messages with a header.
class SequenceWatch {
 public:
  /// How many messages of its publisher are missing between the last one and this one. A number that goes back is that
  /// of a publisher which has begun anew.
  std::uint64_t missingBefore(const Recorded& message);

 private:
  struct Last {
    bool numbered = false;     ///< messages of this type have a header
    std::uint32_t number = 0;  ///< of the last message
  };
  std::map<std::pair<std::string, std::string>, Last> last_;  ///< of topic and publisher
};

}  // namespace cortshift_tracking
