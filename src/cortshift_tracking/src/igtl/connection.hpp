// One peer's stream: bytes in and out, and when it takes too long.
#pragma once

#include <chrono>
#include <functional>
#include <string>

#include "igtl/outbox.hpp"
#include "igtl/sockets.hpp"

namespace cortshift_tracking::igt {

using Clock = std::chrono::steady_clock;

inline Clock::duration seconds(double value) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(value));
}

class Connection {
 public:
  /// @param incoming  it came to our server
  Connection(PeerId id, Descriptor socket, std::string address, bool incoming, const EndpointSettings& settings);

  PeerId id() const { return id_; }
  int socket() const { return socket_.get(); }
  const std::string& address() const { return address_; }
  bool incoming() const { return incoming_; }
  bool wantsToSend(const Outbox& outbox) const { return sending_ || outbox.waiting(id_) > 0; }

  /// Both: why the connection has to end; empty: it goes on.
  /// @throws ProtocolError, and what `on_message` throws
  std::string receive(const std::function<void(const Message&)>& on_message);
  std::string transmit(Outbox& outbox);

  /// @throws ProtocolError where a message that has begun takes too long
  void requireProgress() const;

 private:
  const EndpointSettings& settings_;
  PeerId id_;
  Descriptor socket_;
  std::string address_;
  bool incoming_;
  StreamDecoder decoder_;
  Clock::time_point part_since_;  // of the message that has begun
  Packet sending_;                // taken from the outbox; the first `sent_` bytes are out
  std::size_t sent_ = 0;
  Clock::time_point progress_ = Clock::now();  // last time that the peer took a byte, or had nothing to take
};

}  // namespace cortshift_tracking::igt
