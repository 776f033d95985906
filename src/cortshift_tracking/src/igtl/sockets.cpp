#include "igtl/sockets.hpp"

#include <arpa/inet.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace cortshift_tracking::igt {
namespace {

Descriptor newSocket() { return Descriptor(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)); }

}  // namespace

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

Descriptor listenOn(const std::string& host, int& port) {
  Descriptor server = newSocket();
  const int yes = 1;
  ::setsockopt(server.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr = parseAddress(host, "listen_address");
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  if (!server.valid() || ::bind(server.get(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
      ::listen(server.get(), 64) != 0)
    throw std::runtime_error("cannot listen on " + host + ":" + std::to_string(port) + ": " + std::strerror(errno));
  socklen_t size = sizeof address;
  ::getsockname(server.get(), reinterpret_cast<sockaddr*>(&address), &size);
  port = ntohs(address.sin_port);
  return server;
}

Descriptor startConnecting(const std::string& server) {
  const sockaddr_in address = parseServer(server);
  Descriptor socket = newSocket();
  if (socket.valid() && ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 &&
      errno != EINPROGRESS)
    return Descriptor();
  return socket;
}

}  // namespace cortshift_tracking::igt
