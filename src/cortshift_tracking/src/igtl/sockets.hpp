// IPv4 sockets that do not block.
#pragma once

#include <netinet/in.h>
#include <unistd.h>

#include <string>
#include <utility>

namespace cortshift_tracking::igt {

/// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int value = -1) : value_(value) {}
  Descriptor(Descriptor&& other) noexcept : value_(std::exchange(other.value_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(value_, other.value_);
    return *this;
  }
  ~Descriptor() {
    if (value_ >= 0) ::close(value_);
  }
  int get() const { return value_; }
  bool valid() const { return value_ >= 0; }

 private:
  int value_;
};

/// @param what  names it in the error  @throws std::invalid_argument
in_addr parseAddress(const std::string& text, const char* what);

/// ADDRESS:PORT. Addresses only: looking a name up could stall every other connection. @throws std::invalid_argument
sockaddr_in parseServer(const std::string& server);

std::string addressText(const sockaddr_in& address);

/// @param port  0: any free one; becomes the one that is listened on  @throws std::runtime_error
Descriptor listenOn(const std::string& address, int& port);

/// Not valid where it cannot even be tried; else it can be written to when it is connected or has failed.
Descriptor startConnecting(const std::string& server);

}  // namespace cortshift_tracking::igt
