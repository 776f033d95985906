#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "cortshift_tracking/ros/recording/recorded.hpp"

namespace cortshift_tracking {

/// What still holds though it was said long ago: the last message of every latched topic from every publisher, and
/// every static transform. With it a recording can be understood from any moment on. A static transform that another
/// publisher says later takes the place of the former one; what two say at one time holds twice, so that it is seen.
class HeldMessages {
 public:
  /// @param always topics whose last message holds although they are not latched, such as camera_info
  explicit HeldMessages(std::set<std::string> always = {});

  void keep(const Recorded& message);

  /// What holds, in the order in which it was said, with `time` as its time of arrival.
  std::vector<Recorded> at(const ros::Time& time) const;

 private:
  /// topic, publisher, and of a static transform its child frame: a publisher may say one after the other.
  using Place = std::tuple<std::string, std::string, std::string>;

  void hold(const Place& place, const Recorded& message);

  /// Forgets what other publishers said of a static transform well before `time`.
  void dropReplaced(const std::string& topic, const std::string& caller, const std::string& child,
                    const ros::Time& time);

  std::set<std::string> always_;
  std::map<Place, std::pair<std::uint64_t, Recorded>> held_;  ///< with the order in which it was said
  std::uint64_t count_ = 0;
};

}  // namespace cortshift_tracking
