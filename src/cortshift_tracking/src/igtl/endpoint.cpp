#include "cortshift_tracking/igtl/endpoint.hpp"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <thread>

#include "cortshift_flow/range.hpp"
#include "igtl/connection.hpp"
#include "igtl/outbox.hpp"
#include "igtl/sockets.hpp"

namespace cortshift_tracking::igt {
namespace {

using cortshift_flow::requireRange;

constexpr int kPollMs = 100;        // time-outs are checked at least this often
constexpr double kAcceptPause = 1;  // [s] after the system refused a connection: it will refuse the next one as well

std::string whatOf(const std::exception_ptr& error) {
  try {
    std::rethrow_exception(error);
  } catch (const std::exception& known) {
    return known.what();
  } catch (...) {
    return "an exception of no known type";
  }
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
    port_ = settings_.listen_port;
    if (settings_.listen) server_ = listenOn(settings_.listen_address, port_);
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

  void publish(const std::string& topic, const Packet& packet, bool keep) {
    outbox_.publish(topic, packet, keep);
    wake();
  }

  void send(PeerId peer, const Packet& packet) {
    outbox_.send(peer, packet);
    wake();
  }

  EndpointState state() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return state_;
  }

 private:
  /// A server that we want to be connected to.
  struct Outgoing {
    std::string server;
    Descriptor socket;  // while connecting
    PeerId peer = 0;    // when connected
    double wait = 0;    // before the next attempt [s]
    Clock::time_point next = Clock::now();
    Clock::time_point since;
  };

  void wake() {
    const std::uint64_t one = 1;
    // A full counter means that the thread is going to wake anyway.
    [[maybe_unused]] const ssize_t written = ::write(wake_.get(), &one, sizeof one);
  }

  void run() {
    while (!stop_) {
      try {
        serveOnce();
      } catch (...) {
        failed(whatOf(std::current_exception()));
        ::poll(nullptr, 0, kPollMs);  // whatever it was must not keep a processor busy
      }
    }
    while (!connections_.empty()) close(connections_.back()->id(), "the bridge stops");
  }

  void serveOnce() {
    connectServers();
    const bool accepting = server_.valid() && Clock::now() >= accept_from_;
    std::vector<pollfd> watched = {{wake_.get(), POLLIN, 0}, {accepting ? server_.get() : -1, POLLIN, 0}};
    const std::size_t first_outgoing = watched.size();
    for (const Outgoing& outgoing : outgoing_) watched.push_back({outgoing.socket.get(), POLLOUT, 0});
    const std::size_t first_connection = watched.size();
    for (const auto& connection : connections_)
      watched.push_back(
          {connection->socket(), static_cast<short>(connection->wantsToSend(outbox_) ? POLLIN | POLLOUT : POLLIN), 0});
    if (::poll(watched.data(), watched.size(), kPollMs) < 0 && errno != EINTR)
      throw std::runtime_error(std::string("connections cannot be watched: ") + std::strerror(errno));

    std::uint64_t count = 0;
    while (::read(wake_.get(), &count, sizeof count) > 0) {
    }
    // Connections first: what is accepted below was not watched.
    std::vector<std::pair<PeerId, std::string>> ended;
    for (std::size_t i = 0; i < connections_.size(); ++i) {
      const std::string reason = serve(*connections_[i], watched[first_connection + i].revents);
      if (!reason.empty()) ended.emplace_back(connections_[i]->id(), reason);
    }
    for (const auto& [id, reason] : ended) close(id, reason);
    for (std::size_t i = 0; i < outgoing_.size(); ++i)
      if (watched[first_outgoing + i].revents != 0) finishConnecting(outgoing_[i]);
    if (watched[1].revents != 0) acceptPeers();
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.peers = static_cast<int>(connections_.size());
    state_.unreachable.clear();
    for (const Outgoing& outgoing : outgoing_)
      if (outgoing.peer == 0) state_.unreachable.push_back(outgoing.server);
  }

  /// @return why the connection has to end; empty: it goes on.
  std::string serve(Connection& connection, short events) {
    try {
      if ((events & (POLLIN | POLLHUP | POLLERR)) != 0) {
        const std::string reason = connection.receive([&](const Message& message) {
          {
            const std::lock_guard<std::mutex> lock(mutex_);
            ++state_.received;
          }
          handlers_.on_message(connection.id(), message);
        });
        if (!reason.empty()) return reason;
      }
      connection.requireProgress();
    } catch (const ProtocolError& error) {
      const std::lock_guard<std::mutex> lock(mutex_);
      ++state_.malformed;
      return error.what();
    } catch (...) {
      // Its message may be half done: this connection starts anew, the others have nothing to do with it.
      const std::string what = "a message could not be taken: " + whatOf(std::current_exception());
      failed(what);
      return what;
    }
    return connection.transmit(outbox_);
  }

  void acceptPeers() {
    for (;;) {
      sockaddr_in address{};
      socklen_t size = sizeof address;
      Descriptor socket(
          ::accept4(server_.get(), reinterpret_cast<sockaddr*>(&address), &size, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (!socket.valid()) {
        if (errno == EAGAIN || errno == EWOULDBLOCK) return;
        if (errno == EINTR || errno == ECONNABORTED) continue;
        // No descriptor or memory is left. The peer stays in the queue and would wake us at once, over and over.
        const std::string reason = std::strerror(errno);
        accept_from_ = Clock::now() + seconds(kAcceptPause);
        failed("no peer can connect: " + reason + "; close what holds files or sockets open, or raise `ulimit -n`");
        return;
      }
      const std::string host = addressText(address);
      const auto& allowed = settings_.allowed_peers;
      std::string reason;
      if (std::find(allowed.begin(), allowed.end(), host) == allowed.end())
        reason = "its address is not in allowed_peers";
      else if (std::count_if(connections_.begin(), connections_.end(), [](const auto& c) { return c->incoming(); }) >=
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
      tell([&] { handlers_.on_close(0, name, "refused: " + reason); });
    }
  }

  PeerId open(Descriptor socket, const std::string& address, bool incoming) {
    const PeerId id = ++last_id_;
    connections_.push_back(std::make_unique<Connection>(id, std::move(socket), address, incoming, settings_));
    outbox_.join(id);
    tell([&] { handlers_.on_open(id, address); });
    return id;
  }

  void close(PeerId id, const std::string& reason) {
    const auto at =
        std::find_if(connections_.begin(), connections_.end(), [id](const auto& c) { return c->id() == id; });
    const std::string address = (*at)->address();
    connections_.erase(at);
    outbox_.leave(id);
    for (Outgoing& outgoing : outgoing_)
      if (outgoing.peer == id) {
        outgoing.peer = 0;
        outgoing.next = Clock::now() + seconds(outgoing.wait);
      }
    tell([&] { handlers_.on_close(id, address, reason); });
  }

  void connectServers() {
    for (Outgoing& outgoing : outgoing_) {
      if (outgoing.socket.valid() && Clock::now() - outgoing.since > seconds(settings_.message_timeout))
        postpone(outgoing);  // no answer at all
      if (outgoing.peer != 0 || outgoing.socket.valid() || Clock::now() < outgoing.next) continue;
      outgoing.socket = startConnecting(outgoing.server);
      outgoing.since = Clock::now();
      if (!outgoing.socket.valid()) postpone(outgoing);
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

  /// A handler that fails changes nothing about the connection.
  template <typename Call>
  void tell(const Call& call) {
    try {
      call();
    } catch (...) {
      failed(whatOf(std::current_exception()));
    }
  }

  void failed(const std::string& what) noexcept {
    try {
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        ++state_.failures;
        state_.last_failure = what;
      }
      handlers_.on_failure(what);
    } catch (...) {  // not even this can be said; the count tells
    }
  }

  EndpointSettings settings_;
  EndpointHandlers handlers_;
  Outbox outbox_;
  Descriptor wake_;
  Descriptor server_;
  int port_ = 0;
  PeerId last_id_ = 0;
  std::vector<std::unique_ptr<Connection>> connections_;  // the endpoint's thread alone
  std::vector<Outgoing> outgoing_;                        // likewise
  Clock::time_point accept_from_ = Clock::now();          // likewise
  mutable std::mutex mutex_;                              // guards the state
  EndpointState state_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

Endpoint::Endpoint(const EndpointSettings& settings, EndpointHandlers handlers)
    : implementation_(std::make_unique<Implementation>(settings, std::move(handlers))) {}
Endpoint::~Endpoint() = default;
int Endpoint::port() const { return implementation_->port(); }
void Endpoint::start() { implementation_->start(); }
void Endpoint::publish(const std::string& topic, const Packet& packet, bool keep) {
  implementation_->publish(topic, packet, keep);
}
void Endpoint::send(PeerId peer, const Packet& packet) { implementation_->send(peer, packet); }
EndpointState Endpoint::state() const { return implementation_->state(); }

}  // namespace cortshift_tracking::igt
