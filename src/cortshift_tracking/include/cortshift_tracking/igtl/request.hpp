// What an OpenIGTLink peer may ask of the shift tracker, as text.
#pragma once

#include <string>

namespace cortshift_tracking::igt {

struct Request {
  enum class Kind { kCaptureStage, kComputeShift };
  Kind kind = Kind::kCaptureStage;
  std::string key;               ///< capture_stage
  std::string note;              ///< capture_stage; may be empty
  std::string from_key, to_key;  ///< compute_shift
};

/// `capture_stage KEY [NOTE]` or `compute_shift FROM TO`.
/// @throws std::invalid_argument saying what is wrong and what is understood.
Request parseRequest(const std::string& text);

/// The text of a request that came as a name and a content (COMMAND): either may hold the whole.
std::string joinRequest(const std::string& name, const std::string& content);

}  // namespace cortshift_tracking::igt
