#pragma once

#include <string>

namespace cortshift_tracking {

/// A key names a stage and its file: 1-64 of A-Z a-z 0-9 _ -.
/// @throws TrackingError naming the key and what is wrong with it
void requireKey(const std::string& key);

/// Stands for the brain of the preoperative MR, which no capture may take.
constexpr const char* kMrKey = "pmr";

/// @throws TrackingError for what is no key, or stands for the preoperative MR
void requireKeyOfCapture(const std::string& key);

}  // namespace cortshift_tracking
