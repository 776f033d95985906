// Durable files (cortshift_stereo/durable_file.hpp) whose faults are refusals of a case.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "cortshift_stereo/durable_file.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

/// A file could not be read just now (input/output error, permissions, no memory): nothing is known of its content.
class UnreadableFile : public TrackingError {
 public:
  using TrackingError::TrackingError;
};

/// Ending of a file that is still being written; what a crash leaves has it.
using cortshift_stereo::kPartialEnding;

/// Never replaces a file. @throws TrackingError naming the file and the system's reason; nothing is left behind then
void writeDurably(const std::filesystem::path& path, const void* bytes, std::size_t size);

/// For a file that may exist: at any instant either the old content is there or the new.
/// @throws TrackingError; then the old content is still there, unless the folder could not be synced
void replaceDurably(const std::filesystem::path& path, const void* bytes, std::size_t size);

/// Adds to the end of a file, which is made where there is none. @throws TrackingError
void appendDurably(const std::filesystem::path& path, const void* bytes, std::size_t size);

/// Renames within one file system without replacing anything and syncs both folders. @throws TrackingError
void moveDurably(const std::filesystem::path& from, const std::filesystem::path& to);

/// Moves a file of a case to `set_aside/` in the case folder, under a name that is free there. @throws TrackingError
std::filesystem::path moveAside(const std::filesystem::path& folder, const std::filesystem::path& path,
                                const std::string& aside = "set_aside");

/// @throws UnreadableFile; TrackingError for what is no regular file
std::string readWhole(const std::filesystem::path& path);

/// CRC-32 (ISO 3309, as in zip) of some bytes.
std::uint32_t crc32(const void* bytes, std::size_t size);

}  // namespace cortshift_tracking
