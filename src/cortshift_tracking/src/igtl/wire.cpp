#include "cortshift_tracking/igtl/wire.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>

#include "igtl/header.hpp"

namespace cortshift_tracking::igt {
namespace {

constexpr std::size_t kExtendedHeaderSize = 12;
constexpr std::size_t kTrackingElementSize = 70;
constexpr std::size_t kCommandNameSize = 128;
constexpr double kQuaternionTolerance = 1e-3;

/// Reads big-endian values from the front of a range and never past its end.
class Reader {
 public:
  Reader(const std::uint8_t* data, std::size_t size, std::string what)
      : at_(data), left_(size), what_(std::move(what)) {}
  explicit Reader(const Message& message) : Reader(message.content.data(), message.content.size(), message.type) {}

  std::size_t left() const { return left_; }

  const std::uint8_t* take(std::size_t size) {
    if (size > left_)
      throw ProtocolError(what_ + " is too short: " + std::to_string(size) + " bytes wanted, " + std::to_string(left_) +
                          " left");
    const std::uint8_t* start = at_;
    at_ += size;
    left_ -= size;
    return start;
  }

  std::uint64_t integer(std::size_t size) {
    const std::uint8_t* bytes = take(size);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < size; ++i) value = value << 8 | bytes[i];
    return value;
  }
  std::uint16_t u16() { return static_cast<std::uint16_t>(integer(2)); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(integer(4)); }

  double f32() {
    const std::uint32_t bits = u32();
    float value = 0;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }

  std::string text(std::size_t size) { return {reinterpret_cast<const char*>(take(size)), size}; }

  /// Text in a field of fixed size, ended by the first 0.
  std::string field(std::size_t size) {
    std::string value = text(size);
    value.resize(std::min(value.find('\0'), value.size()));
    return value;
  }

  void finish() const {
    if (left_ != 0) throw ProtocolError(what_ + " is " + std::to_string(left_) + " bytes too long");
  }

 private:
  const std::uint8_t* at_;
  std::size_t left_;
  std::string what_;
};

struct Header {
  std::uint16_t version;
  std::string type, device;
  std::int64_t stamp_ns;
  std::uint64_t body_size, crc;
};

/// Names end up in logs: control characters are refused.
void requirePrintable(const std::string& text, const std::string& what) {
  if (std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; }))
    throw ProtocolError(what + " holds control characters");
}

Header parseHeader(const std::uint8_t* data) {
  Reader in(data, kHeaderSize, "header");
  Header header{};
  header.version = in.u16();
  if (header.version < 1 || header.version > 2)
    throw ProtocolError("header version " + std::to_string(header.version) + " is not known; known are 1 and 2");
  header.type = in.field(kTypeSize);
  if (header.type.empty() || !std::all_of(header.type.begin(), header.type.end(), [](unsigned char c) {
        return (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
      }))
    throw ProtocolError("the message type is not made of A-Z 0-9 _");
  header.device = in.field(kDeviceSize);
  requirePrintable(header.device, "device name");
  const std::int64_t seconds = in.u32();
  header.stamp_ns = seconds * kNanoseconds + nanosecondsFromFraction(in.u32());
  header.body_size = in.integer(8);
  header.crc = in.integer(8);
  return header;
}

std::map<std::string, std::string> parseMetadata(Reader index, Reader body) {
  std::map<std::string, std::string> metadata;
  const std::size_t count = index.u16();
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t key_size = index.u16();
    index.u16();  // character set of the value; we compare ASCII words only
    const std::size_t value_size = index.u32();
    const std::string key = body.text(key_size);
    metadata[key] = body.text(value_size);
  }
  index.finish();
  body.finish();
  return metadata;
}

Message parseBody(const Header& header, const std::uint8_t* body, std::size_t size) {
  if (checksum(body, size) != header.crc)
    throw ProtocolError("the checksum of " + header.type + " from '" + header.device + "' is wrong");
  Message message;
  message.version = header.version;
  message.type = header.type;
  message.device = header.device;
  message.stamp_ns = header.stamp_ns;
  if (header.version == 1) {
    message.content.assign(body, body + size);
    return message;
  }
  Reader in(body, size, "extended header");
  const std::size_t extended_size = in.u16();
  const std::size_t index_size = in.u16();
  const std::size_t metadata_size = in.u32();
  in.u32();  // message id
  if (extended_size < kExtendedHeaderSize) throw ProtocolError("the extended header is too short");
  in.take(extended_size - kExtendedHeaderSize);  // from a later protocol than we know
  if (index_size + metadata_size > in.left()) throw ProtocolError("the metadata is longer than the message");
  const std::size_t content_size = in.left() - index_size - metadata_size;
  const std::uint8_t* content = in.take(content_size);
  message.content.assign(content, content + content_size);
  const std::uint8_t* index = in.take(index_size);
  if (index_size > 0)
    message.metadata = parseMetadata(Reader(index, index_size, "metadata index"),
                                     Reader(in.take(metadata_size), metadata_size, "metadata"));
  return message;
}

/// TRANSFORM and TDATA: the columns of the 3 x 4 matrix, one after the other.
Eigen::Matrix4d readMatrix(Reader& in) {
  Eigen::Matrix4d matrix_mm = Eigen::Matrix4d::Identity();
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 3; ++row) matrix_mm(row, column) = in.f32();
  return matrix_mm;
}

ToolSample decodePosition(const Message& message) {
  const std::size_t size = message.content.size();
  if (size != 12 && size != 24 && size != 28)
    throw ProtocolError("POSITION has " + std::to_string(size) + " bytes; allowed is 12, 24, 28");
  if (size == 12) return {message.device, std::nullopt, "the position comes without orientation"};
  Reader in(message);
  Eigen::Vector3d position_mm;
  for (double& coordinate : position_mm) coordinate = in.f32();
  Eigen::Quaterniond rotation;
  for (int i = 0; i < 3; ++i) rotation.coeffs()[i] = in.f32();
  // The short form leaves w out: it is not negative there.
  rotation.w() = size == 28 ? in.f32() : std::sqrt(std::max(0.0, 1 - rotation.vec().squaredNorm()));
  if (!(std::abs(rotation.norm() - 1) <= kQuaternionTolerance))
    return {message.device, std::nullopt, "the quaternion does not have length 1"};
  Eigen::Matrix4d matrix_mm = Eigen::Matrix4d::Identity();
  matrix_mm.topLeftCorner<3, 3>() = rotation.normalized().toRotationMatrix();
  matrix_mm.topRightCorner<3, 1>() = position_mm;
  return {message.device, matrix_mm, ""};
}

std::vector<ToolSample> decodeTrackingData(const Message& message) {
  if (message.content.size() % kTrackingElementSize != 0)
    throw ProtocolError("TDATA has " + std::to_string(message.content.size()) + " bytes; each tool takes " +
                        std::to_string(kTrackingElementSize));
  std::vector<ToolSample> samples;
  Reader in(message);
  while (in.left() > 0) {
    ToolSample sample;
    sample.tool = in.field(kDeviceSize);
    requirePrintable(sample.tool, "tool name");
    const std::uint64_t kind = in.integer(1);
    in.integer(1);  // reserved
    const Eigen::Matrix4d matrix_mm = readMatrix(in);
    if (kind == 1 || kind == 2)  // a tracker, or a 6D instrument; 3 and 4 leave degrees of freedom out
      sample.matrix_mm = matrix_mm;
    else
      sample.reason = "the tool does not give all six degrees of freedom (kind " + std::to_string(kind) + ")";
    samples.push_back(sample);
  }
  return samples;
}

}  // namespace

void StreamDecoder::append(const std::uint8_t* data, std::size_t size) {
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(used_));
  used_ = 0;
  buffer_.insert(buffer_.end(), data, data + size);
}

std::optional<Message> StreamDecoder::next() {
  if (buffer_.size() - used_ < kHeaderSize) return std::nullopt;
  const std::uint8_t* start = buffer_.data() + used_;
  const Header header = parseHeader(start);
  if (header.body_size > max_message_bytes_)
    throw ProtocolError(header.type + " announces " + std::to_string(header.body_size) + " bytes; allowed is " +
                        std::to_string(max_message_bytes_));
  const std::size_t size = kHeaderSize + static_cast<std::size_t>(header.body_size);
  if (buffer_.size() - used_ < size) return std::nullopt;
  Message message = parseBody(header, start + kHeaderSize, size - kHeaderSize);
  used_ += size;
  return message;
}

std::vector<ToolSample> decodePoses(const Message& message) {
  std::vector<ToolSample> samples;
  if (message.type == "TRANSFORM") {
    Reader in(message);
    const Eigen::Matrix4d matrix_mm = readMatrix(in);
    in.finish();
    samples.push_back({message.device, matrix_mm, ""});
  } else if (message.type == "POSITION") {
    samples.push_back(decodePosition(message));
  } else if (message.type == "TDATA") {
    samples = decodeTrackingData(message);
  } else {
    throw ProtocolError(message.type + " holds no poses");
  }
  for (const char* key : {"Status", "TransformStatus"}) {
    const auto status = message.metadata.find(key);
    if (status == message.metadata.end() || status->second == "OK") continue;
    requirePrintable(status->second, "status");
    for (ToolSample& sample : samples) sample = {sample.tool, std::nullopt, "the device says " + status->second};
  }
  return samples;
}

std::string decodeString(const Message& message) {
  Reader in(message);
  in.u16();  // character set: ASCII or UTF-8, which we treat alike
  const std::size_t size = in.u16();
  std::string text = in.text(size);
  in.finish();
  return text;
}

Command decodeCommand(const Message& message) {
  Reader in(message);
  Command command;
  command.id = in.u32();
  command.name = in.field(kCommandNameSize);
  requirePrintable(command.name, "command name");
  in.u16();  // character set
  const std::size_t size = in.u32();
  command.text = in.text(size);
  in.finish();
  return command;
}

Status decodeStatus(const Message& message) {
  Reader in(message);
  Status status;
  status.code = in.u16();
  in.integer(8);  // device's own sub-code
  in.take(20);    // device's name of the error
  status.text = in.field(in.left());
  return status;
}

}  // namespace cortshift_tracking::igt
