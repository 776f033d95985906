// What waits for each peer. Filled by any thread, emptied by the endpoint's.
#pragma once

#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "cortshift_tracking/igtl/endpoint.hpp"

namespace cortshift_tracking::igt {

class Outbox {
 public:
  void join(PeerId peer);
  void leave(PeerId peer);

  /// To every peer; see Endpoint::publish.
  void publish(const std::string& topic, const Packet& packet, bool keep);
  void send(PeerId peer, const Packet& packet);  ///< a peer that has left is no error

  std::size_t waiting(PeerId peer) const;
  Packet take(PeerId peer);  ///< the oldest; null: nothing waits

 private:
  struct Entry {
    std::string topic;  // a newer packet takes the place; empty: none does
    Packet packet;
  };
  using Queue = std::deque<Entry>;
  static void put(Queue& queue, const std::string& topic, const Packet& packet);

  mutable std::mutex mutex_;
  std::map<PeerId, Queue> queues_;
  std::map<std::string, Packet> kept_;
};

}  // namespace cortshift_tracking::igt
