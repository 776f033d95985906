#include "cortshift_stereo/durable_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <new>

namespace cortshift_stereo {
namespace {

template <typename Error = FileError>
[[noreturn]] void fail(const std::string& action, const std::filesystem::path& path, int error) {
  throw Error("cannot " + action + " " + path.string() + ": " + std::strerror(error) +
              "; check that the disk is there, has room and may be read and written");
}

class FileDescriptor {
 public:
  FileDescriptor(const std::filesystem::path& path, int flags)
      : number_(::open(path.c_str(), flags | O_CLOEXEC, 0644)) {}
  ~FileDescriptor() {
    if (number_ >= 0) ::close(number_);
  }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;

  int number() const { return number_; }
  bool isOpen() const { return number_ >= 0; }
  bool close() {
    const int number = number_;
    number_ = -1;
    return ::close(number) == 0;
  }

 private:
  int number_;
};

void syncFolder(const std::filesystem::path& of) {
  const std::filesystem::path folder = of.empty() ? "." : of;
  const FileDescriptor descriptor(folder, O_RDONLY | O_DIRECTORY);
  if (!descriptor.isOpen() || ::fsync(descriptor.number()) != 0) fail("sync", folder, errno);
}

void writeAll(int descriptor, const std::filesystem::path& path, const void* bytes, std::size_t size) {
  const auto* at = static_cast<const char*>(bytes);
  while (size > 0) {
    const ssize_t written = ::write(descriptor, at, size);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) fail("write", path, written == 0 ? ENOSPC : errno);
    at += written;
    size -= static_cast<std::size_t>(written);
  }
}

/// rename(2) that refuses to replace; file systems that do not know the flag get a check before.
void renameWithoutReplacing(const std::filesystem::path& from, const std::filesystem::path& to) {
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return;
  if (errno != EINVAL && errno != ENOSYS) fail("rename " + from.string() + " to", to, errno);
  struct stat existing {};
  if (::lstat(to.c_str(), &existing) == 0) fail("rename " + from.string() + " to", to, EEXIST);
  if (::rename(from.c_str(), to.c_str()) != 0) fail("rename " + from.string() + " to", to, errno);
}

void renameAndReplace(const std::filesystem::path& from, const std::filesystem::path& to) {
  if (::rename(from.c_str(), to.c_str()) != 0) fail("rename " + from.string() + " to", to, errno);
}

/// Writes and syncs a temporary file beside `path`, then gives it that name by `rename`; leaves nothing of it on
/// failure.
template <typename Rename>
void writeBeside(const std::filesystem::path& path, const void* bytes, std::size_t size, const Rename& rename) {
  const std::filesystem::path partial = path.string() + kPartialEnding;
  FileDescriptor file(partial, O_WRONLY | O_CREAT | O_TRUNC);
  if (!file.isOpen()) fail("create", partial, errno);
  try {
    writeAll(file.number(), partial, bytes, size);
    if (::fsync(file.number()) != 0) fail("sync", partial, errno);
    if (!file.close()) fail("close", partial, errno);
    rename(partial, path);
  } catch (const FileError&) {
    ::unlink(partial.c_str());
    throw;
  }
}

}  // namespace

const char* const kPartialEnding = ".partial";

void replaceDurably(const std::filesystem::path& path, const void* bytes, std::size_t size) {
  writeBeside(path, bytes, size, renameAndReplace);
  syncFolder(path.parent_path());
}

void writeDurably(const std::filesystem::path& path, const void* bytes, std::size_t size) {
  writeBeside(path, bytes, size, renameWithoutReplacing);
  try {
    syncFolder(path.parent_path());
  } catch (const FileError&) {
    ::unlink(path.c_str());
    throw;
  }
}

void appendDurably(const std::filesystem::path& path, const void* bytes, std::size_t size) {
  FileDescriptor file(path, O_WRONLY | O_APPEND | O_CREAT);
  if (!file.isOpen()) fail("open", path, errno);
  writeAll(file.number(), path, bytes, size);
  if (::fsync(file.number()) != 0) fail("sync", path, errno);
  if (!file.close()) fail("close", path, errno);
  syncFolder(path.parent_path());
}

void moveDurably(const std::filesystem::path& from, const std::filesystem::path& to) {
  renameWithoutReplacing(from, to);
  syncFolder(to.parent_path());
  syncFolder(from.parent_path());
}

std::string readWhole(const std::filesystem::path& path) {
  const FileDescriptor file(path, O_RDONLY);
  struct stat status {};
  if (!file.isOpen() || ::fstat(file.number(), &status) != 0) fail<UnreadableError>("open", path, errno);
  if (!S_ISREG(status.st_mode)) throw FileError(path.string() + " is not a file");
  std::string bytes;
  try {
    bytes.resize(static_cast<std::size_t>(status.st_size));
  } catch (const std::bad_alloc&) {
    fail<UnreadableError>("read", path, ENOMEM);
  }
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t got = ::read(file.number(), &bytes[done], bytes.size() - done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail<UnreadableError>("read", path, errno);
    if (got == 0) throw UnreadableError(path.string() + " became shorter while it was read");
    done += static_cast<std::size_t>(got);
  }
  return bytes;
}

}  // namespace cortshift_stereo
