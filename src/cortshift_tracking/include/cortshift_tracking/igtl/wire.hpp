// Bytes from an OpenIGTLink peer to messages. Every length is checked against what has arrived before it is used:
// a peer may be broken or hostile.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace cortshift_tracking::igt {

using Bytes = std::vector<std::uint8_t>;

/// Bytes that break the protocol or our limits. The connection that sent them is closed.
class ProtocolError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

constexpr std::size_t kHeaderSize = 58;
constexpr std::size_t kDeviceSize = 20;  ///< characters of a device name

/// One received message of header version 1 or 2 (protocol versions 1 to 3).
struct Message {
  std::uint16_t version = 1;
  std::string type;                             ///< TRANSFORM, TDATA, ...
  std::string device;                           ///< device (message) name
  std::int64_t stamp_ns = 0;                    ///< since 1970 by the device's clock; 0: the device gave none
  std::map<std::string, std::string> metadata;  ///< header version 2 only
  Bytes content;                                ///< the body without extended header and metadata
};

/// Cuts a byte stream into messages.
class StreamDecoder {
 public:
  /// @param max_message_bytes  largest body that a peer may announce
  explicit StreamDecoder(std::size_t max_message_bytes) : max_message_bytes_(max_message_bytes) {}

  void append(const std::uint8_t* data, std::size_t size);

  /// The next whole message, or nothing until more bytes arrive.
  /// @throws ProtocolError; the stream cannot be followed any further.
  std::optional<Message> next();

  /// Whether a message has begun and not ended.
  bool holdsPart() const { return buffer_.size() > used_; }

 private:
  std::size_t max_message_bytes_;
  Bytes buffer_;
  std::size_t used_ = 0;
};

/// What a message says about one tool.
struct ToolSample {
  std::string tool;                          ///< device name; for TDATA the tool's own name
  std::optional<Eigen::Matrix4d> matrix_mm;  ///< pose as sent; nothing where the tool was not seen whole
  std::string reason;                        ///< why there is no pose
};

/// Poses of TRANSFORM, POSITION (with orientation) and TDATA. A "Status" or "TransformStatus" in the metadata that is
/// not OK makes the sample one without pose.
/// @throws ProtocolError if the content does not have the form that the type asks for.
std::vector<ToolSample> decodePoses(const Message& message);

/// Text of a STRING message. @throws ProtocolError
std::string decodeString(const Message& message);

/// A COMMAND of protocol version 3.
struct Command {
  std::uint32_t id = 0;
  std::string name;
  std::string text;
};
/// @throws ProtocolError
Command decodeCommand(const Message& message);

/// Code (1: OK) and text of a STATUS message. @throws ProtocolError
struct Status {
  std::uint16_t code = 0;
  std::string text;
};
Status decodeStatus(const Message& message);

}  // namespace cortshift_tracking::igt
