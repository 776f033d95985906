#include "cortshift_tracking/case/stage_key.hpp"

#include <algorithm>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

void requireKey(const std::string& key) {
  const std::string rule = std::string("; a key is ") + kKeyRule;
  if (key.empty()) throw TrackingError("the key is empty" + rule);
  if (!std::all_of(key.begin(), key.end(), mayStandInKey)) {
    std::string shown;  // the answer must stay printable whatever came in
    for (const char c : key.substr(0, 80)) shown += c >= ' ' && c <= '~' ? c : '?';
    throw TrackingError("key '" + shown + "' holds a character that is not allowed" + rule);
  }
  if (key.size() > kLongestKey)
    throw TrackingError("key '" + key.substr(0, kLongestKey) + "...' has " + std::to_string(key.size()) +
                        " characters" + rule);
}

void requireKeyOfCapture(const std::string& key) {
  requireKey(key);
  if (key == kMrKey)
    throw TrackingError("key '" + key + "' stands for the preoperative MR; choose another for a captured stage");
}

}  // namespace cortshift_tracking
