// What the fuzzer makes, as a file in memory with a path.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>

class BytesAsFile {
 public:
  BytesAsFile(const std::uint8_t* data, std::size_t size) : handle_(::memfd_create("fuzz", MFD_CLOEXEC)) {
    for (std::size_t at = 0; at < size;) {
      const ssize_t written = ::write(handle_, data + at, size - at);
      if (written <= 0) std::abort();
      at += static_cast<std::size_t>(written);
    }
  }
  ~BytesAsFile() { ::close(handle_); }
  BytesAsFile(const BytesAsFile&) = delete;
  BytesAsFile& operator=(const BytesAsFile&) = delete;

  std::string path() const { return "/proc/self/fd/" + std::to_string(handle_); }

 private:
  int handle_;
};
