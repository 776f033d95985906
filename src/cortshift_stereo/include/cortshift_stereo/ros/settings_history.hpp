// The microscope's setting at the time of an exposure.
#pragma once

#include <cortshift_msgs/MicroscopeSettings.h>

#include <cstddef>
#include <iterator>
#include <map>

namespace cortshift_stereo {

/// Settings are reported when they change; each holds until the next one.
class SettingsHistory {
 public:
  /// A change before the newest one starts the history anew: a recording that runs again.
  void add(const cortshift_msgs::MicroscopeSettingsConstPtr& change) {
    const ros::Time& stamp = change->header.stamp;
    if (!changes_.empty() && stamp < changes_.rbegin()->first) changes_.clear();
    changes_[stamp] = change;
    if (changes_.size() > kKept) changes_.erase(changes_.begin());
  }

  /// The setting in force; before the first change, the first. Null where none has been reported.
  cortshift_msgs::MicroscopeSettingsConstPtr at(const ros::Time& stamp) const {
    if (changes_.empty()) return nullptr;
    const auto next = changes_.upper_bound(stamp);
    return next == changes_.begin() ? next->second : std::prev(next)->second;
  }

 private:
  static constexpr std::size_t kKept = 256;
  std::map<ros::Time, cortshift_msgs::MicroscopeSettingsConstPtr> changes_;
};

}  // namespace cortshift_stereo
