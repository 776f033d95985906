// What an OpenIGTLink peer may send. The first byte says in what pieces it arrives.
#include "cortshift_tracking/igtl/request.hpp"
#include "cortshift_tracking/igtl/tool_board.hpp"
#include "cortshift_tracking/igtl/wire.hpp"
#include "packets.hpp"

using namespace cortshift_tracking::igt;

namespace {

constexpr std::int64_t kNow = 1700000000000000000;

void digest(const Message& message, ToolBoard& board) try {
  if (message.type == "STRING" || message.type == "COMMAND") {
    const std::string text = message.type == "STRING" ? decodeString(message) : decodeCommand(message).text;
    parseRequest(joinRequest("capture_stage", text));
  } else {
    if (message.type == "STATUS") decodeStatus(message);
    board.receive(1, message, kNow);
  }
} catch (const ProtocolError&) {
} catch (const std::invalid_argument&) {
}

void follow(const std::uint8_t* data, std::size_t size, std::size_t piece, ToolBoard& board) try {
  StreamDecoder decoder(4096);
  for (std::size_t at = 0; at < size; at += piece) {
    decoder.append(data + at, std::min(piece, size - at));
    while (const auto message = decoder.next()) digest(*message, board);
  }
} catch (const ProtocolError&) {
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  ToolBoardSettings settings;
  settings.tools = {{"M", "reference", "microscope", 0}, {"P", "reference", "pmr", 0}};
  ToolBoard board(settings, LinkSpace(Axes::kRas, Axes::kLps));
  follow(data + 2, size - 2, 1 + data[0], board);
  // The same bytes as a body with the right checksum, which no mutation finds: that stops no attacker.
  static const char* const kTypes[] = {"TRANSFORM", "POSITION", "TDATA",  "STATUS",
                                       "STRING",    "COMMAND",  "QTDATA", "IMAGE"};
  const Bytes body(data + 2, data + size);
  const Bytes whole = packet(1 + data[1] / 8 % 2, kTypes[data[1] % 8], "M", kNow, body);
  follow(whole.data(), whole.size(), 1 + data[0], board);
  return 0;
}
