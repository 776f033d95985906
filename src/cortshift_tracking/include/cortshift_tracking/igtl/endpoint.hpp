// The network side of the OpenIGTLink bridge: one thread that listens, connects, receives and sends.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "cortshift_tracking/igtl/wire.hpp"

namespace cortshift_tracking::igt {

/// Each default is written here and nowhere else.
struct EndpointSettings {
  bool listen = true;                                      ///< be a server
  std::string listen_address = "127.0.0.1";                ///< IPv4 address of the interface to listen on
  int listen_port = 18944;                                 ///< 0: any free one
  std::vector<std::string> allowed_peers = {"127.0.0.1"};  ///< IPv4 addresses that may connect
  std::vector<std::string> servers;                        ///< IPv4address:port to connect to as a client
  int max_clients = 8;                                     ///< connections to our server at a time
  int max_message_bytes = 16 << 20;                        ///< largest body that a peer may send
  double message_timeout = 5;                              ///< longest time that one message may take to arrive [s]
  double send_timeout = 20;    ///< longest time that a peer may take nothing of what waits [s]
  double reconnect_min = 0.5;  ///< first wait before connecting again [s]; doubles ...
  double reconnect_max = 10;   ///< ... up to this [s]

  /// @throws std::invalid_argument naming the setting, its value and what is allowed.
  void validate() const;
};

using PeerId = std::uint64_t;
using Packet = std::shared_ptr<const Bytes>;
inline Packet toPacket(Bytes bytes) { return std::make_shared<const Bytes>(std::move(bytes)); }

/// Called from the endpoint's thread, which outlives whatever they throw. An exception from `on_message` closes the
/// connection of that message and nothing else: a ProtocolError for what the peer sent, any other one as our failure.
struct EndpointHandlers {
  std::function<void(PeerId, const std::string& address)> on_open;
  std::function<void(PeerId, const Message&)> on_message;
  std::function<void(PeerId, const std::string& address, const std::string& reason)> on_close;
  std::function<void(const std::string& what)> on_failure;  ///< of ours, not of a peer's; the endpoint goes on
};

struct EndpointState {
  int peers = 0;                         ///< open connections
  std::uint64_t received = 0;            ///< whole messages
  std::uint64_t refused = 0;             ///< peers that may not connect, or one too many
  std::uint64_t malformed = 0;           ///< connections closed for what they sent
  std::uint64_t failures = 0;            ///< what on_failure was told
  std::string last_failure;              ///< the latest of them
  std::vector<std::string> unreachable;  ///< servers without a connection
};

class Endpoint {
 public:
  /// Listens at once. @throws std::runtime_error if the address cannot be listened on.
  Endpoint(const EndpointSettings& settings, EndpointHandlers handlers);
  ~Endpoint();
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  int port() const;  ///< that is listened on

  /// Starts to serve; before, peers wait.
  void start();

  /// To every peer. `topic` names what is replaced: a peer that has not yet been sent the last packet of a topic gets
  /// only the newer one, so that no queue grows. `keep`: a peer that connects later gets the last one.
  void publish(const std::string& topic, const Packet& packet, bool keep);

  /// To one peer, in order. A peer that is gone is no error: nobody waits for the answer.
  void send(PeerId peer, const Packet& packet);

  EndpointState state() const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace cortshift_tracking::igt
