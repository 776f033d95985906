// What was in force at the time of an exposure.
#pragma once

#include <ros/time.h>

#include <boost/shared_ptr.hpp>
#include <cstddef>
#include <iterator>
#include <map>

namespace cortshift_stereo {

/// Messages that hold from their stamp until the next one's: the microscope's settings, a camera's calibration.
template <typename Message>
class StampedHistory {
 public:
  using ConstPtr = boost::shared_ptr<const Message>;

  /// A stamp before the newest one starts the history anew: a recording that runs again.
  void add(const ConstPtr& change) {
    const ros::Time& stamp = change->header.stamp;
    if (!changes_.empty() && stamp < changes_.rbegin()->first) changes_.clear();
    changes_[stamp] = change;
    if (changes_.size() > kKept) changes_.erase(changes_.begin());
  }

  bool empty() const { return changes_.empty(); }

  /// The one in force; before the first, the first. Null where none has come.
  ConstPtr at(const ros::Time& stamp) const {
    if (changes_.empty()) return nullptr;
    const auto next = changes_.upper_bound(stamp);
    return next == changes_.begin() ? next->second : std::prev(next)->second;
  }

 private:
  static constexpr std::size_t kKept = 256;
  std::map<ros::Time, ConstPtr> changes_;
};

}  // namespace cortshift_stereo
