#include "igtl/connection.hpp"

#include <netinet/tcp.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>

namespace cortshift_tracking::igt {
namespace {

constexpr std::size_t kChunk = 64 * 1024;
constexpr std::size_t kMaxReplies = 256;  // waiting for one peer

}  // namespace

Connection::Connection(PeerId id, Descriptor socket, std::string address, bool incoming,
                       const EndpointSettings& settings)
    : settings_(settings),
      id_(id),
      socket_(std::move(socket)),
      address_(std::move(address)),
      incoming_(incoming),
      decoder_(static_cast<std::size_t>(settings.max_message_bytes)) {
  const int yes = 1;
  ::setsockopt(socket_.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  ::setsockopt(socket_.get(), SOL_SOCKET, SO_KEEPALIVE, &yes, sizeof yes);
}

void Connection::requireProgress() const {
  if (decoder_.holdsPart() && Clock::now() - part_since_ > seconds(settings_.message_timeout))
    throw ProtocolError("a message did not arrive whole within " + std::to_string(settings_.message_timeout) + " s");
}

std::string Connection::receive(const std::function<void(const Message&)>& on_message) {
  std::uint8_t chunk[kChunk];
  const ssize_t size = ::recv(socket_.get(), chunk, sizeof chunk, 0);
  if (size == 0) return "the peer closed the connection";
  if (size < 0) return errno == EAGAIN || errno == EINTR ? "" : std::strerror(errno);
  if (!decoder_.holdsPart()) part_since_ = Clock::now();
  decoder_.append(chunk, static_cast<std::size_t>(size));
  while (const std::optional<Message> message = decoder_.next()) {
    part_since_ = Clock::now();
    on_message(*message);
  }
  return "";
}

std::string Connection::transmit(Outbox& outbox) {
  for (;;) {
    if (!sending_) {
      if (outbox.waiting(id_) > kMaxReplies) return "the peer asks faster than it takes the answers";
      sending_ = outbox.take(id_);
      sent_ = 0;
      if (!sending_) {
        progress_ = Clock::now();
        return "";
      }
    }
    const ssize_t size = ::send(socket_.get(), sending_->data() + sent_, sending_->size() - sent_, MSG_NOSIGNAL);
    if (size < 0) {
      if (errno != EAGAIN && errno != EINTR) return std::strerror(errno);
      if (Clock::now() - progress_ > seconds(settings_.send_timeout))
        return "the peer took nothing for " + std::to_string(settings_.send_timeout) + " s";
      return "";
    }
    progress_ = Clock::now();
    sent_ += static_cast<std::size_t>(size);
    if (sent_ == sending_->size()) sending_.reset();
  }
}

}  // namespace cortshift_tracking::igt
