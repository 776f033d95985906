#include "case/failing_disk.hpp"

#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <string>

namespace failing_disk {

std::atomic<long> room{kUnlimited};
std::atomic<bool> sync_works{true};
std::atomic<int> read_failure{0};
std::atomic<int> lock_failure{0};
std::atomic<const char*> streams_that_fail{""};

}  // namespace failing_disk

using namespace failing_disk;

extern "C" ssize_t write(int descriptor, const void* bytes, size_t size) {
  if (room == kUnlimited) return ::syscall(SYS_write, descriptor, bytes, size);
  const size_t taken = std::min(size, static_cast<size_t>(room.load()));
  if (taken == 0 && size > 0) {
    errno = ENOSPC;
    return -1;
  }
  room -= static_cast<long>(taken);
  return ::syscall(SYS_write, descriptor, bytes, taken);
}

extern "C" int fsync(int descriptor) {
  if (sync_works) return static_cast<int>(::syscall(SYS_fsync, descriptor));
  errno = EIO;
  return -1;
}

extern "C" ssize_t read(int descriptor, void* bytes, size_t size) {
  if (read_failure == 0) return ::syscall(SYS_read, descriptor, bytes, size);
  errno = read_failure;
  return -1;
}

extern "C" int flock(int descriptor, int operation) noexcept {
  if (lock_failure == 0) return static_cast<int>(::syscall(SYS_flock, descriptor, operation));
  errno = lock_failure;
  return -1;
}

static bool failing(FILE* file) {
  const std::string ending = streams_that_fail.load();
  if (ending.empty()) return false;
  char path[PATH_MAX];
  const std::string link = "/proc/self/fd/" + std::to_string(::fileno(file));
  const ssize_t size = ::readlink(link.c_str(), path, sizeof path);
  const std::string name(path, static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  return name.size() >= ending.size() && name.compare(name.size() - ending.size(), ending.size(), ending) == 0;
}

extern "C" size_t fread(void* bytes, size_t size, size_t count, FILE* file) {
  if (failing(file)) {
    errno = EIO;
    return 0;
  }
  ::flockfile(file);
  const size_t got = ::fread_unlocked(bytes, size, count, file);
  ::funlockfile(file);
  return got;
}
