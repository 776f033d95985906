#pragma once

#include <algorithm>
#include <string>

namespace cortshift_tracking {

/// A key names a stage and becomes part of a file's name. In words, and as a regular expression.
constexpr const char* kKeyRule = "1-64 of A-Z a-z 0-9 _ -";
constexpr const char* kKeyPattern = "[A-Za-z0-9_-]{1,64}";
constexpr std::size_t kLongestKey = 64;

inline bool mayStandInKey(char c) {
  return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
}

inline bool isKey(const std::string& text) {
  return !text.empty() && text.size() <= kLongestKey && std::all_of(text.begin(), text.end(), mayStandInKey);
}

/// @throws TrackingError naming the key and what is wrong with it
void requireKey(const std::string& key);

/// Stands for the brain of the preoperative MR, which no capture may take.
constexpr const char* kMrKey = "pmr";

/// @throws TrackingError for what is no key, or stands for the preoperative MR
void requireKeyOfCapture(const std::string& key);

}  // namespace cortshift_tracking
