// Random, truncated and mutated bytes through everything that reads from the network. Built with the sanitizers.
#include <gtest/gtest.h>

#include <random>

#include "cortshift_tracking/igtl/compose.hpp"
#include "cortshift_tracking/igtl/request.hpp"
#include "cortshift_tracking/igtl/tool_board.hpp"
#include "packets.hpp"

namespace cortshift_tracking::igt {
namespace {

struct Outcome {
  int messages = 0, refused = 0, poses = 0;
};

/// All that the bridge does with a message.
void digest(const Message& message, ToolBoard& board, std::int64_t now_ns, Outcome* outcome) {
  ++outcome->messages;
  if (message.type == "STRING" || message.type == "COMMAND") {
    const std::string text = message.type == "STRING" ? decodeString(message) : decodeCommand(message).text;
    try {
      parseRequest(joinRequest("capture_stage", text));
    } catch (const std::invalid_argument&) {
      ++outcome->refused;
    }
  } else {
    outcome->poses += static_cast<int>(board.receive(1, message, now_ns).size());
  }
}

TEST(Fuzz, NothingGetsPastTheReader) {
  std::mt19937 random(20140918);
  const auto below = [&](std::size_t limit) {
    return std::uniform_int_distribution<std::size_t>(0, limit - 1)(random);
  };
  ToolBoardSettings settings;
  settings.tools = {{"M", "reference", "microscope", 0}};
  ToolBoard board(settings, LinkSpace(Axes::kRas, Axes::kLps));
  constexpr std::int64_t kStart = 1700000000000000000;
  const char* const types[] = {"TRANSFORM", "POSITION", "TDATA", "STATUS", "STRING", "COMMAND", "IMAGE"};
  Outcome outcome;
  int closed = 0, wrong_content = 0;
  for (int round = 0; round < 60000; ++round) {
    const std::int64_t stamp_ns = kStart + round * 1000;
    const std::string type = types[below(7)];
    Bytes content = transformContent(Eigen::Matrix4d::Identity());
    if (type != "TRANSFORM" || below(4) == 0) {
      content.resize(below(400));
      for (std::uint8_t& byte : content) byte = static_cast<std::uint8_t>(below(256));
    }
    if ((type == "STRING" || type == "COMMAND") && below(2) == 0) {
      std::string text(below(60), ' ');
      for (char& letter : text) letter = static_cast<char>(' ' + below(90));
      content.clear();
      if (type == "COMMAND") put(content, "capture_stage", 4 + 128);
      put(content, 3, 2);
      put(content, text.size(), type == "COMMAND" ? 4 : 2);
      put(content, text, text.size());
    }
    // Half of the messages are mutated within a body whose checksum is right: the checksum stops no attacker.
    Bytes bytes = below(2) == 0
                      ? packetV1(type, "M", stamp_ns, content)
                      : packetV2(type, "M", stamp_ns, content, {{"Status", below(2) == 0 ? "OK" : "INVALID"}});
    if (bytes.size() > kHeaderSize && below(2) == 0) {
      Bytes body(bytes.begin() + kHeaderSize, bytes.end());
      for (std::size_t i = below(6); i > 0; --i) body[below(body.size())] = static_cast<std::uint8_t>(below(256));
      body.resize(body.size() - below(std::min<std::size_t>(body.size(), 20)));
      bytes = packet(1 + static_cast<int>(below(2)), type, "M", stamp_ns, body);
    }
    for (std::size_t i = below(8) == 0 ? 1 + below(4) : 0; i > 0; --i) bytes[below(bytes.size())] ^= 1 << below(8);
    if (below(8) == 0) bytes.resize(below(bytes.size()));

    StreamDecoder decoder(4096);
    try {
      for (std::size_t at = 0; at < bytes.size();) {
        const std::size_t size = std::min(bytes.size() - at, 1 + below(200));
        decoder.append(bytes.data() + at, size);
        at += size;
        while (const auto message = decoder.next()) {
          try {
            digest(*message, board, stamp_ns, &outcome);
          } catch (const ProtocolError&) {
            ++wrong_content;
          }
        }
      }
    } catch (const ProtocolError&) {
      ++closed;
    }
  }
  // Every branch was reached: good messages, wrong contents, streams given up.
  EXPECT_GT(outcome.messages, 10000);
  EXPECT_GT(outcome.poses, 300);
  EXPECT_GT(outcome.refused, 100);
  EXPECT_GT(wrong_content, 1000);
  EXPECT_GT(closed, 1000);
}

}  // namespace
}  // namespace cortshift_tracking::igt
