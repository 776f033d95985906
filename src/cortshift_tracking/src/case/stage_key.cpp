#include "cortshift_tracking/case/stage_key.hpp"

#include <algorithm>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

void requireKey(const std::string& key) {
  const std::string rule = "; a key is 1-64 of A-Z a-z 0-9 _ -";
  if (key.empty()) throw TrackingError("the key is empty" + rule);
  const auto allowed = [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  };
  if (!std::all_of(key.begin(), key.end(), allowed)) {
    std::string shown;  // the answer must stay printable whatever came in
    for (const char c : key.substr(0, 80)) shown += c >= ' ' && c <= '~' ? c : '?';
    throw TrackingError("key '" + shown + "' holds a character that is not allowed" + rule);
  }
  if (key.size() > 64)
    throw TrackingError("key '" + key.substr(0, 64) + "...' has " + std::to_string(key.size()) + " characters" + rule);
}

void requireKeyOfCapture(const std::string& key) {
  requireKey(key);
  if (key == kMrKey)
    throw TrackingError("key '" + key + "' stands for the preoperative MR; choose another for a captured stage");
}

}  // namespace cortshift_tracking
