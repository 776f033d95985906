// Files that are there whole or not at all, whatever happens while they are written.
#pragma once

#include <cstddef>
#include <filesystem>
#include <stdexcept>
#include <string>

namespace cortshift_stereo {

/// Names the file and the system's reason.
class FileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A file could not be read just now (input/output error, permissions, no memory): nothing is known of its content.
class UnreadableError : public FileError {
 public:
  using FileError::FileError;
};

/// Ending of a file that is still being written; what a crash leaves has it.
extern const char* const kPartialEnding;

/// Writes `bytes` to a temporary name beside `path`, syncs, renames and syncs the folder. When this returns, the file
/// survives a power cut; an existing file is never replaced.
/// @throws FileError; nothing is left behind then
void writeDurably(const std::filesystem::path& path, const void* bytes, std::size_t size);

/// The same for a file that may exist: at any instant either the old content is there or the new.
/// @throws FileError; then the old content is still there, unless the folder could not be synced
void replaceDurably(const std::filesystem::path& path, const void* bytes, std::size_t size);

/// Adds to the end of a file, which is made where there is none. @throws FileError; a part may have been added then
void appendDurably(const std::filesystem::path& path, const void* bytes, std::size_t size);

/// Renames within one file system without replacing anything and syncs both folders. @throws FileError
void moveDurably(const std::filesystem::path& from, const std::filesystem::path& to);

/// @throws UnreadableError; FileError for what is no regular file
std::string readWhole(const std::filesystem::path& path);

}  // namespace cortshift_stereo
