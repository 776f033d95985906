// The microscope's setting at the time of an exposure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>

#include "cortshift_stereo/calibration/settings_warp.hpp"

namespace cortshift_stereo {

/// Settings are reported when they change; each holds until the next one.
class SettingsHistory {
 public:
  /// @param stamp_ns  time of the change; one before the newest starts the history anew: a recording that runs again
  void add(std::int64_t stamp_ns, const MicroscopeSetting& setting) {
    if (!changes_.empty() && stamp_ns < changes_.rbegin()->first) changes_.clear();
    changes_[stamp_ns] = setting;
    if (changes_.size() > kKept) changes_.erase(changes_.begin());
  }

  /// The setting in force; before the first change, the first. Nothing where none has been reported.
  std::optional<MicroscopeSetting> at(std::int64_t stamp_ns) const {
    if (changes_.empty()) return std::nullopt;
    const auto next = changes_.upper_bound(stamp_ns);
    return next == changes_.begin() ? next->second : std::prev(next)->second;
  }

 private:
  static constexpr std::size_t kKept = 256;
  std::map<std::int64_t, MicroscopeSetting> changes_;
};

}  // namespace cortshift_stereo
