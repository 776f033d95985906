#include "cortshift_tracking/igtl/endpoint.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <deque>
#include <map>
#include <sstream>

namespace cortshift_tracking::igt {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kChunk = 64 * 1024;
constexpr std::size_t kMaxReplies = 256;  // waiting for one peer
constexpr int kPollMs = 100;              // time-outs are checked at least this often

Clock::duration seconds(double value) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(value));
}

/// A file descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int value = -1) : value_(value) {}
  Descriptor(Descriptor&& other) noexcept : value_(other.value_) { other.value_ = -1; }
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

in_addr parseAddress(const std::string& text, const char* what) {
  in_addr address{};
  if (::inet_pton(AF_INET, text.c_str(), &address) != 1)
    throw std::invalid_argument(std::string(what) + " = '" + text + "' is not an IPv4 address such as 127.0.0.1");
  return address;
}

std::string addressText(const sockaddr_in& address) {
  char text[INET_ADDRSTRLEN] = "";
  ::inet_ntop(AF_INET, &address.sin_addr, text, sizeof text);
  return text;
}

/// ADDRESS:PORT. Addresses only: looking a name up could stall every other connection.
sockaddr_in parseServer(const std::string& server) {
  const std::size_t colon = server.rfind(':');
  const std::string port = colon == std::string::npos ? "" : server.substr(colon + 1);
  const bool digits = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  if (!digits || std::stoi(port) < 1 || std::stoi(port) > 65535)
    throw std::invalid_argument("servers: '" + server + "' is not allowed; allowed is ADDRESS:PORT, port 1 ... 65535");
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr = parseAddress(server.substr(0, colon), "servers");
  address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(port)));
  return address;
}

template <typename T>
void requireRange(const char* name, T value, T low, T high) {
  if (value >= low && value <= high) return;
  std::ostringstream text;
  text << name << " = " << value << " is not allowed; allowed is " << low << " ... " << high;
  throw std::invalid_argument(text.str());
}

}  // namespace

void EndpointSettings::validate() const {
  parseAddress(listen_address, "listen_address");
  for (const std::string& peer : allowed_peers) parseAddress(peer, "allowed_peers");
  for (const std::string& server : servers) parseServer(server);
  requireRange("listen_port", listen_port, 0, 65535);
  requireRange("max_clients", max_clients, 1, 100);
  requireRange("max_message_bytes", max_message_bytes, 1024, 256 << 20);
  requireRange("message_timeout", message_timeout, 0.1, 60.0);
  requireRange("send_timeout", send_timeout, 0.1, 600.0);
  requireRange("reconnect_min", reconnect_min, 0.05, 60.0);
  requireRange("reconnect_max", reconnect_max, reconnect_min, 600.0);
}

class Endpoint::Implementation {
 public:
  Implementation(const EndpointSettings& settings, EndpointHandlers handlers)
      : settings_(settings), handlers_(std::move(handlers)), wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    settings_.validate();
    if (!wake_.valid()) throw std::runtime_error(std::string("no event descriptor: ") + std::strerror(errno));
    if (settings_.listen) openServer();
    for (const std::string& server : settings_.servers) {
      Outgoing outgoing;
      outgoing.server = server;
      outgoing.wait = settings_.reconnect_min;
      outgoing_.push_back(std::move(outgoing));
    }
  }

  ~Implementation() {
    stop_ = true;
    wake();
    if (thread_.joinable()) thread_.join();
  }

  int port() const { return port_; }

  void start() {
    if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
  }

  void publish(const std::string& topic, Packet packet, bool keep) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      for (auto& [id, queue] : queues_) queue.put(topic, packet);
      if (keep) kept_[topic] = std::move(packet);
    }
    wake();
  }

  void send(PeerId peer, Packet packet) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      const auto queue = queues_.find(peer);
      if (queue == queues_.end()) return;
      queue->second.put("", std::move(packet));
    }
    wake();
  }

  EndpointState state() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return state_;
  }

 private:
  /// What waits for one peer.
  struct Queue {
    struct Entry {
      std::string topic;
      Packet packet;
    };
    std::deque<Entry> entries;

    void put(const std::string& topic, Packet packet) {
      if (!topic.empty())
        for (Entry& entry : entries)
          if (entry.topic == topic) {
            entry.packet = std::move(packet);
            return;
          }
      entries.push_back({topic, std::move(packet)});
    }
  };

  struct Connection {
    Connection(PeerId id, Descriptor socket, std::string address, std::size_t max_message_bytes)
        : id(id), socket(std::move(socket)), address(std::move(address)), decoder(max_message_bytes) {}
    PeerId id;
    Descriptor socket;
    std::string address;
    StreamDecoder decoder;
    Clock::time_point part_since;  // of the message that has begun
    Packet sending;                // taken from the queue; the first `sent` bytes are out
    std::size_t sent = 0;
    Clock::time_point progress;  // last time that the peer took a byte, or had nothing to take
    bool incoming = true;        // it came to our server
  };

  /// A server that we want to be connected to.
  struct Outgoing {
    std::string server;
    Descriptor socket;  // while connecting
    PeerId peer = 0;    // when connected
    double wait = 0;    // before the next attempt [s]
    Clock::time_point next = Clock::now();
    Clock::time_point since;
  };

  void openServer() {
    server_ = Descriptor(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const int yes = 1;
    ::setsockopt(server_.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr = parseAddress(settings_.listen_address, "listen_address");
    address.sin_port = htons(static_cast<std::uint16_t>(settings_.listen_port));
    if (!server_.valid() || ::bind(server_.get(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
        ::listen(server_.get(), 64) != 0)
      throw std::runtime_error("cannot listen on " + settings_.listen_address + ":" +
                               std::to_string(settings_.listen_port) + ": " + std::strerror(errno));
    socklen_t size = sizeof address;
    ::getsockname(server_.get(), reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
  }

  void wake() {
    const std::uint64_t one = 1;
    // A full counter means that the thread is going to wake anyway.
    [[maybe_unused]] const ssize_t written = ::write(wake_.get(), &one, sizeof one);
  }

  void run() {
    while (!stop_) {
      connectServers();
      std::vector<pollfd> watched = {{wake_.get(), POLLIN, 0}};
      if (server_.valid()) watched.push_back({server_.get(), POLLIN, 0});
      const std::size_t first_outgoing = watched.size();
      for (const Outgoing& outgoing : outgoing_) watched.push_back({outgoing.socket.get(), POLLOUT, 0});
      const std::size_t first_connection = watched.size();
      for (const auto& connection : connections_)
        watched.push_back(
            {connection->socket.get(), static_cast<short>(wantsToSend(*connection) ? POLLIN | POLLOUT : POLLIN), 0});
      ::poll(watched.data(), watched.size(), kPollMs);

      std::uint64_t count = 0;
      while (::read(wake_.get(), &count, sizeof count) > 0) {
      }
      // Connections first: what is accepted below was not watched.
      std::vector<std::pair<PeerId, std::string>> ended;
      for (std::size_t i = 0; i < connections_.size(); ++i) {
        const std::string reason = serve(*connections_[i], watched[first_connection + i].revents);
        if (!reason.empty()) ended.emplace_back(connections_[i]->id, reason);
      }
      for (const auto& [id, reason] : ended) close(id, reason);
      for (std::size_t i = 0; i < outgoing_.size(); ++i)
        if (watched[first_outgoing + i].revents != 0) finishConnecting(outgoing_[i]);
      if (server_.valid() && watched[1].revents != 0) acceptPeers();
      const std::lock_guard<std::mutex> lock(mutex_);
      state_.peers = static_cast<int>(connections_.size());
      state_.unreachable.clear();
      for (const Outgoing& outgoing : outgoing_)
        if (outgoing.peer == 0) state_.unreachable.push_back(outgoing.server);
    }
    while (!connections_.empty()) close(connections_.back()->id, "the bridge stops");
  }

  bool wantsToSend(const Connection& connection) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return connection.sending || !queues_[connection.id].entries.empty();
  }

  /// @return why the connection has to end; empty: it goes on.
  std::string serve(Connection& connection, short events) {
    try {
      if ((events & (POLLIN | POLLHUP | POLLERR)) != 0) {
        const std::string reason = receive(connection);
        if (!reason.empty()) return reason;
      }
      if (connection.decoder.holdsPart() && Clock::now() - connection.part_since > seconds(settings_.message_timeout))
        throw ProtocolError("a message did not arrive whole within " + std::to_string(settings_.message_timeout) +
                            " s");
    } catch (const ProtocolError& error) {
      const std::lock_guard<std::mutex> lock(mutex_);
      ++state_.malformed;
      return error.what();
    }
    return transmit(connection);
  }

  std::string receive(Connection& connection) {
    std::uint8_t chunk[kChunk];
    const ssize_t size = ::recv(connection.socket.get(), chunk, sizeof chunk, 0);
    if (size == 0) return "the peer closed the connection";
    if (size < 0) return errno == EAGAIN || errno == EINTR ? "" : std::strerror(errno);
    if (!connection.decoder.holdsPart()) connection.part_since = Clock::now();
    connection.decoder.append(chunk, static_cast<std::size_t>(size));
    while (const std::optional<Message> message = connection.decoder.next()) {
      connection.part_since = Clock::now();
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        ++state_.received;
      }
      handlers_.on_message(connection.id, *message);
    }
    return "";
  }

  std::string transmit(Connection& connection) {
    for (;;) {
      if (!connection.sending) {
        const std::lock_guard<std::mutex> lock(mutex_);
        auto& entries = queues_[connection.id].entries;
        if (entries.empty()) {
          connection.progress = Clock::now();
          return "";
        }
        if (entries.size() > kMaxReplies) return "the peer asks faster than it takes the answers";
        connection.sending = entries.front().packet;
        connection.sent = 0;
        entries.pop_front();
      }
      const Bytes& bytes = *connection.sending;
      const ssize_t size =
          ::send(connection.socket.get(), bytes.data() + connection.sent, bytes.size() - connection.sent, MSG_NOSIGNAL);
      if (size < 0) {
        if (errno != EAGAIN && errno != EINTR) return std::strerror(errno);
        if (Clock::now() - connection.progress > seconds(settings_.send_timeout))
          return "the peer took nothing for " + std::to_string(settings_.send_timeout) + " s";
        return "";
      }
      connection.progress = Clock::now();
      connection.sent += static_cast<std::size_t>(size);
      if (connection.sent == bytes.size()) connection.sending.reset();
    }
  }

  void acceptPeers() {
    for (;;) {
      sockaddr_in address{};
      socklen_t size = sizeof address;
      Descriptor socket(
          ::accept4(server_.get(), reinterpret_cast<sockaddr*>(&address), &size, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (!socket.valid()) return;
      const std::string host = addressText(address);
      const auto& allowed = settings_.allowed_peers;
      std::string reason;
      if (std::find(allowed.begin(), allowed.end(), host) == allowed.end())
        reason = "its address is not in allowed_peers";
      else if (std::count_if(connections_.begin(), connections_.end(), [](const auto& c) { return c->incoming; }) >=
               settings_.max_clients)
        reason = "max_clients = " + std::to_string(settings_.max_clients) + " are connected";
      const std::string name = host + ":" + std::to_string(ntohs(address.sin_port));
      if (reason.empty()) {
        open(std::move(socket), name, true);
        continue;
      }
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        ++state_.refused;
      }
      handlers_.on_close(0, name, "refused: " + reason);
    }
  }

  PeerId open(Descriptor socket, const std::string& address, bool incoming) {
    const int yes = 1;
    ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    ::setsockopt(socket.get(), SOL_SOCKET, SO_KEEPALIVE, &yes, sizeof yes);
    const PeerId id = ++last_id_;
    connections_.push_back(std::make_unique<Connection>(id, std::move(socket), address,
                                                        static_cast<std::size_t>(settings_.max_message_bytes)));
    connections_.back()->incoming = incoming;
    connections_.back()->progress = Clock::now();
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      Queue& queue = queues_[id];
      for (const auto& [topic, packet] : kept_) queue.put(topic, packet);
    }
    handlers_.on_open(id, address);
    return id;
  }

  void close(PeerId id, const std::string& reason) {
    const auto at = std::find_if(connections_.begin(), connections_.end(), [id](const auto& c) { return c->id == id; });
    const std::string address = (*at)->address;
    connections_.erase(at);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      queues_.erase(id);
    }
    for (Outgoing& outgoing : outgoing_)
      if (outgoing.peer == id) {
        outgoing.peer = 0;
        outgoing.next = Clock::now() + seconds(outgoing.wait);
      }
    handlers_.on_close(id, address, reason);
  }

  void connectServers() {
    for (Outgoing& outgoing : outgoing_) {
      if (outgoing.socket.valid() && Clock::now() - outgoing.since > seconds(settings_.message_timeout))
        postpone(outgoing);  // no answer at all
      if (outgoing.peer != 0 || outgoing.socket.valid() || Clock::now() < outgoing.next) continue;
      outgoing.socket = Descriptor(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
      outgoing.since = Clock::now();
      const sockaddr_in address = parseServer(outgoing.server);
      if (::connect(outgoing.socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 &&
          errno != EINPROGRESS)
        postpone(outgoing);
    }
  }

  void finishConnecting(Outgoing& outgoing) {
    int error = 0;
    socklen_t size = sizeof error;
    ::getsockopt(outgoing.socket.get(), SOL_SOCKET, SO_ERROR, &error, &size);
    if (error != 0) {
      postpone(outgoing);
      return;
    }
    outgoing.wait = settings_.reconnect_min;
    Descriptor socket = std::move(outgoing.socket);
    outgoing.peer = open(std::move(socket), outgoing.server, false);
  }

  void postpone(Outgoing& outgoing) {
    outgoing.socket = Descriptor();
    outgoing.next = Clock::now() + seconds(outgoing.wait);
    outgoing.wait = std::min(2 * outgoing.wait, settings_.reconnect_max);
  }

  EndpointSettings settings_;
  EndpointHandlers handlers_;
  Descriptor wake_;
  Descriptor server_;
  int port_ = 0;
  PeerId last_id_ = 0;
  std::vector<std::unique_ptr<Connection>> connections_;  // the endpoint's thread alone
  std::vector<Outgoing> outgoing_;                        // likewise
  mutable std::mutex mutex_;                              // guards the next three
  std::map<PeerId, Queue> queues_;
  std::map<std::string, Packet> kept_;
  EndpointState state_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

Endpoint::Endpoint(const EndpointSettings& settings, EndpointHandlers handlers)
    : implementation_(std::make_unique<Implementation>(settings, std::move(handlers))) {}
Endpoint::~Endpoint() = default;
int Endpoint::port() const { return implementation_->port(); }
void Endpoint::start() { implementation_->start(); }
void Endpoint::publish(const std::string& topic, Packet packet, bool keep) {
  implementation_->publish(topic, std::move(packet), keep);
}
void Endpoint::send(PeerId peer, Packet packet) { implementation_->send(peer, std::move(packet)); }
EndpointState Endpoint::state() const { return implementation_->state(); }

}  // namespace cortshift_tracking::igt
