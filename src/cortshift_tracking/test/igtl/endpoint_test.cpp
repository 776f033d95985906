#include "cortshift_tracking/igtl/endpoint.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <functional>
#include <map>
#include <thread>

#include "cortshift_tracking/igtl/compose.hpp"
#include "packets.hpp"

namespace {

std::atomic<bool> descriptors_left{true};
std::atomic<int> refused_accepts{0};

}  // namespace

/// In the place of the system's: as if every file descriptor of the process were in use.
extern "C" int accept4(int socket, sockaddr* address, socklen_t* size, int flags) {
  if (descriptors_left) return static_cast<int>(::syscall(SYS_accept4, socket, address, size, flags));
  ++refused_accepts;
  errno = EMFILE;
  return -1;
}

namespace cortshift_tracking::igt {
namespace {

using std::chrono::steady_clock;

/// Waits up to 20 s; a test that depends on less would fail on a busy machine.
bool eventually(const std::function<bool()>& condition) {
  for (const auto end = steady_clock::now() + std::chrono::seconds(20); steady_clock::now() < end;) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

/// A plain TCP peer.
class Peer {
 public:
  explicit Peer(int port, const char* from = "127.0.0.1") : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    ::inet_pton(AF_INET, from, &address.sin_addr);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    ::inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    EXPECT_EQ(::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    const timeval timeout{20, 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
  }
  ~Peer() { ::close(socket_); }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  void send(const Bytes& bytes) {
    for (std::size_t at = 0; at < bytes.size();) {
      const ssize_t size = ::send(socket_, bytes.data() + at, bytes.size() - at, MSG_NOSIGNAL);
      if (size <= 0) return;
      at += static_cast<std::size_t>(size);
    }
  }
  /// @return nothing where the endpoint closed the connection (or 20 s passed).
  std::optional<Message> receive() {
    for (;;) {
      if (auto message = decoder_.next()) return message;
      std::uint8_t chunk[65536];
      const ssize_t size = ::recv(socket_, chunk, sizeof chunk, 0);
      if (size <= 0) return std::nullopt;
      decoder_.append(chunk, static_cast<std::size_t>(size));
    }
  }

 private:
  int socket_;
  StreamDecoder decoder_{128 << 20};
};

/// An endpoint that answers STRING with the same text, calls "bad" a breach of the protocol and fails over "odd".
class EndpointTest : public ::testing::Test {
 protected:
  void start(EndpointSettings settings) {
    settings.listen_port = 0;
    EndpointHandlers handlers;
    handlers.on_open = [](PeerId, const std::string&) {};
    handlers.on_message = [this](PeerId peer, const Message& message) {
      const std::string text = decodeString(message);
      if (text == "bad") throw ProtocolError("bad");
      if (text == "odd") throw std::runtime_error("no such thing");
      if (text == "odder") throw 7;
      echoing_->send(peer, std::make_shared<const Bytes>(composeString({"echo", 1}, text)));
    };
    handlers.on_close = [this](PeerId, const std::string&, const std::string&) {
      const std::lock_guard<std::mutex> lock(mutex_);
      ++closings_;
      if (close_fails_) throw std::bad_alloc();
    };
    handlers.on_failure = [this](const std::string& what) {
      const std::lock_guard<std::mutex> lock(mutex_);
      ++failures_[what];
    };
    endpoint_ = std::make_unique<Endpoint>(settings, handlers);
    echoing_ = endpoint_.get();
    endpoint_->start();
  }
  void TearDown() override { endpoint_.reset(); }

  static void expectEcho(Peer& peer, const std::string& text) {
    peer.send(composeString({"ask", 1}, text));
    const auto answer = peer.receive();
    ASSERT_TRUE(answer);
    EXPECT_EQ(decodeString(*answer), text);
  }

  std::mutex mutex_;
  std::map<std::string, int> failures_;
  int closings_ = 0;
  bool close_fails_ = false;
  std::unique_ptr<Endpoint> endpoint_;
  Endpoint* echoing_ = nullptr;  // the same for its own thread, which still runs while the pointer above is reset
};

TEST_F(EndpointTest, BreachClosesThatConnectionAlone) {
  start({});
  Peer good(endpoint_->port()), content(endpoint_->port()), stream(endpoint_->port());
  expectEcho(good, "one");
  content.send(composeString({"ask", 1}, "bad"));
  stream.send(Bytes(500, 0xff));
  EXPECT_FALSE(content.receive());
  EXPECT_FALSE(stream.receive());
  expectEcho(good, "two");
  EXPECT_TRUE(eventually([&] { return endpoint_->state().malformed == 2; }));
}

TEST_F(EndpointTest, OutlivesWhateverItsHandlersThrow) {
  start({});
  Peer good(endpoint_->port()), odd(endpoint_->port()), odder(endpoint_->port());
  expectEcho(good, "one");
  odd.send(composeString({"ask", 1}, "odd"));
  EXPECT_FALSE(odd.receive()) << "what became of its message is not known";
  // The handler is told after the peer has seen it.
  EXPECT_TRUE(eventually([&] {
    const std::lock_guard<std::mutex> lock(mutex_);
    close_fails_ = closings_ == 1;
    return close_fails_;
  }));
  odder.send(composeString({"ask", 1}, "odder"));
  EXPECT_FALSE(odder.receive());
  EXPECT_TRUE(eventually([&] { return endpoint_->state().failures == 3; }));
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    close_fails_ = false;
  }
  expectEcho(good, "two");
  Peer later(endpoint_->port());
  expectEcho(later, "three");
  EXPECT_EQ(endpoint_->state().malformed, 0u);
  const std::lock_guard<std::mutex> lock(mutex_);
  EXPECT_EQ(failures_["a message could not be taken: no such thing"], 1);
  EXPECT_EQ(failures_["a message could not be taken: an exception of no known type"], 1);
  EXPECT_EQ(failures_["std::bad_alloc"], 1);
}

TEST_F(EndpointTest, WaitsWhereNoDescriptorIsLeft) {
  start({});
  Peer before(endpoint_->port());
  expectEcho(before, "one");
  refused_accepts = 0;
  descriptors_left = false;
  Peer waiting(endpoint_->port());
  EXPECT_TRUE(eventually([&] { return endpoint_->state().failures >= 2; }));
  expectEcho(before, "two");
  // Asked once before each pause, not as often as the processor can.
  EXPECT_LE(refused_accepts, static_cast<int>(endpoint_->state().failures) + 1);
  EXPECT_EQ(endpoint_->state().last_failure,
            "no peer can connect: Too many open files; close what holds files or sockets open, or raise `ulimit -n`");
  descriptors_left = true;
  expectEcho(waiting, "three");
}

TEST_F(EndpointTest, OnlyAllowedPeers) {
  start({});
  Peer stranger(endpoint_->port(), "127.0.0.9");
  EXPECT_FALSE(stranger.receive());
  EXPECT_TRUE(eventually([&] { return endpoint_->state().refused == 1; }));
  EndpointSettings settings;
  settings.allowed_peers = {"127.0.0.9"};
  start(settings);
  Peer friendly(endpoint_->port(), "127.0.0.9");
  expectEcho(friendly, "hello");
  Peer other(endpoint_->port());
  EXPECT_FALSE(other.receive());
}

TEST_F(EndpointTest, NoMoreThanMaxClients) {
  EndpointSettings settings;
  settings.max_clients = 2;
  start(settings);
  Peer first(endpoint_->port());
  auto second = std::make_unique<Peer>(endpoint_->port());
  expectEcho(first, "1");
  expectEcho(*second, "2");
  EXPECT_FALSE(Peer(endpoint_->port()).receive());
  second.reset();
  EXPECT_TRUE(eventually([&] { return endpoint_->state().peers == 1; }));
  Peer third(endpoint_->port());
  expectEcho(third, "3");
}

TEST_F(EndpointTest, HalfAMessageIsNotWaitedForForEver) {
  EndpointSettings settings;
  settings.message_timeout = 0.2;
  start(settings);
  Peer slow(endpoint_->port()), idle(endpoint_->port());
  Bytes half = composeString({"ask", 1}, "half");
  half.resize(60);
  slow.send(half);
  EXPECT_FALSE(slow.receive());
  expectEcho(idle, "silence is no crime");
}

TEST_F(EndpointTest, LateComersGetTheLastOfWhatIsKept) {
  start({});
  for (const char* text : {"old", "new"})
    endpoint_->publish("summary", std::make_shared<const Bytes>(composeString({"s", 1}, text)), true);
  endpoint_->publish("event", std::make_shared<const Bytes>(composeString({"e", 1}, "gone")), false);
  Peer late(endpoint_->port());
  EXPECT_EQ(decodeString(late.receive().value()), "new");
  expectEcho(late, "nothing else came");
}

// A peer that does not read gets the newest packet of a topic when it does, and no queue grows meanwhile.
TEST_F(EndpointTest, SlowPeersSkip) {
  start({});
  Peer slow(endpoint_->port()), fast(endpoint_->port());
  expectEcho(slow, "here");
  expectEcho(fast, "here");
  const int last = 100;
  const std::size_t size = 60000;
  int got = 0;
  std::thread reader([&] {
    while (const auto message = fast.receive()) {
      ++got;
      if (message->stamp_ns / 1000000000 == last) return;
    }
  });
  for (int i = 1; i <= last; ++i) {
    Bytes many;
    for (int part = 0; part < 20; ++part) {
      const Bytes one = composeString({"surface", std::int64_t{i} * 1000000000}, std::string(size, 'x'));
      many.insert(many.end(), one.begin(), one.end());
    }
    endpoint_->publish("surface", std::make_shared<const Bytes>(many), false);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  reader.join();
  int messages = 0;
  for (std::int64_t stamp = 0; stamp != last;) {
    const auto message = slow.receive();
    ASSERT_TRUE(message);
    stamp = message->stamp_ns / 1000000000;
    ++messages;
  }
  EXPECT_LT(messages, 20 * last / 2);
  EXPECT_GT(got, 0);
}

// An updated MR of a whole head, 256 x 256 x 256 voxels, to a peer that takes it slowly: every voxel arrives, the
// answer to what it asked meanwhile comes after it, and others do not wait.
TEST_F(EndpointTest, AWholeHeadArrives) {
  constexpr int kSide = 256;
  std::vector<float> values(static_cast<std::size_t>(kSide) * kSide * kSide);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i % 1021);
  start({});
  Peer slow(endpoint_->port()), other(endpoint_->port());
  expectEcho(slow, "here");
  endpoint_->publish("UpdatedMR",
                     toPacket(composeVolume({"UpdatedMR", 5}, {kSide, kSide, kSide, values.data()},
                                            Eigen::Matrix4d::Identity(), Axes::kLps)),
                     true);
  slow.send(composeString({"ask", 1}, "and then?"));
  const auto first = other.receive();
  const auto head = slow.receive(), answer = slow.receive();
  for (const auto& message : {head, first}) {
    ASSERT_TRUE(message);
    EXPECT_EQ(message->type, "IMAGE");
    ASSERT_GT(message->content.size(), 4 * values.size());
    EXPECT_EQ(std::memcmp(message->content.data() + message->content.size() - 4 * values.size(), values.data(),
                          4 * values.size()),
              0);
  }
  ASSERT_TRUE(answer);
  EXPECT_EQ(decodeString(*answer), "and then?");
}

TEST_F(EndpointTest, ConnectsAgainToServers) {
  EndpointSettings listening;
  listening.listen_port = 0;
  EndpointHandlers quiet;
  quiet.on_open = [](PeerId, const std::string&) {};
  quiet.on_message = [](PeerId, const Message&) {};
  quiet.on_close = [](PeerId, const std::string&, const std::string&) {};
  auto server = std::make_unique<Endpoint>(listening, quiet);
  server->start();
  EndpointSettings settings;
  settings.listen = false;
  settings.servers = {"127.0.0.1:" + std::to_string(server->port())};
  settings.reconnect_min = 0.05;
  settings.reconnect_max = 0.2;
  start(settings);
  EXPECT_TRUE(eventually([&] { return endpoint_->state().peers == 1 && server->state().peers == 1; }));
  listening.listen_port = server->port();
  server.reset();
  EXPECT_TRUE(eventually([&] { return endpoint_->state().unreachable.size() == 1; }));
  server = std::make_unique<Endpoint>(listening, quiet);
  server->start();
  EXPECT_TRUE(eventually([&] { return server->state().peers == 1 && endpoint_->state().unreachable.empty(); }));
}

TEST(EndpointSettings, RefusesTheImpossible) {
  const auto refused = [](const std::function<void(EndpointSettings&)>& change) {
    EndpointSettings settings;
    change(settings);
    EXPECT_THROW(settings.validate(), std::invalid_argument);
  };
  EndpointSettings().validate();
  EndpointSettings smallest;
  smallest.max_message_bytes = 1024;
  EXPECT_NO_THROW(smallest.validate());
  refused([](EndpointSettings& s) { s.listen_address = "localhost"; });
  refused([](EndpointSettings& s) { s.allowed_peers = {"10.0.0.256"}; });
  refused([](EndpointSettings& s) { s.servers = {"127.0.0.1"}; });
  refused([](EndpointSettings& s) { s.servers = {"127.0.0.1:70000"}; });
  refused([](EndpointSettings& s) { s.servers = {"tracker:18944"}; });
  refused([](EndpointSettings& s) { s.listen_port = -1; });
  refused([](EndpointSettings& s) { s.max_message_bytes = 1023; });
  refused([](EndpointSettings& s) { s.reconnect_max = 0.1; });
}

}  // namespace
}  // namespace cortshift_tracking::igt
