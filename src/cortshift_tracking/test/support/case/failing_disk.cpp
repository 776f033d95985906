#include "case/failing_disk.hpp"

#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace failing_disk {

std::atomic<long> room{kUnlimited};
std::atomic<bool> sync_works{true};
std::atomic<int> read_failure{0};

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
