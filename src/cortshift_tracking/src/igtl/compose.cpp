#include "cortshift_tracking/igtl/compose.hpp"

#include <igtlImageMessage.h>
#include <igtlStatusMessage.h>
#include <igtlStringMessage.h>
#include <igtlTrackingDataMessage.h>

#include <algorithm>
#include <cstring>
#include <mutex>
#include <stdexcept>

#include "igtl/header.hpp"

namespace cortshift_tracking::igt {
namespace {

constexpr int kUtf8 = 106;  // IANA's number of the character set

/// The library's object factory is not made for several threads.
std::mutex library_mutex;

void append(Bytes& out, std::uint64_t value, int size) {
  for (int byte = size - 1; byte >= 0; --byte)
    out.push_back(byte < 8 ? static_cast<std::uint8_t>(value >> 8 * byte & 0xff) : 0);
}

void appendText(Bytes& out, const std::string& text, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) out.push_back(i < text.size() ? static_cast<std::uint8_t>(text[i]) : 0);
}

void append(Bytes& out, float value) {
  std::uint32_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  append(out, bits, 4);
}

void append(Bytes& out, const std::vector<Eigen::Vector3f>& vectors) {
  for (const Eigen::Vector3f& v : vectors)
    for (int i = 0; i < 3; ++i) append(out, v[i]);
}

/// Point data of POLYDATA; all are float32.
struct Attribute {
  int type;  // of the protocol: 0 scalar, 1 vector, 4 RGBA
  int components;
  std::string name;
  Bytes data;
};

std::vector<Attribute> attributesOf(const LinkMesh& mesh) {
  std::vector<Attribute> attributes;
  if (!mesh.displacements_mm.empty()) {
    attributes.push_back({1, 3, "displacement", {}});
    append(attributes.back().data, mesh.displacements_mm);
  }
  if (!mesh.confidence.empty()) {
    attributes.push_back({0, 1, "confidence", {}});
    for (const float value : mesh.confidence) append(attributes.back().data, value);
  }
  if (!mesh.colours_rgb.empty()) {
    attributes.push_back({4, 4, "rgba", {}});
    for (const Eigen::Vector3f& colour : mesh.colours_rgb) {
      for (int i = 0; i < 3; ++i) append(attributes.back().data, colour[i]);
      append(attributes.back().data, 1.0F);
    }
  }
  return attributes;
}

/// Every header is written here, whoever packed the body.
Bytes withHeader(std::uint16_t version, const std::string& type, const Label& label, const Bytes& body) {
  if (label.device.size() > kDeviceSize)
    throw std::invalid_argument("device name '" + label.device + "' is longer than " + std::to_string(kDeviceSize) +
                                " characters");
  Bytes message;
  message.reserve(kHeaderSize + body.size());
  append(message, version, 2);
  appendText(message, type, kTypeSize);
  appendText(message, label.device, kDeviceSize);
  append(message, static_cast<std::uint64_t>(label.stamp_ns / kNanoseconds), 4);
  append(message, fractionFromNanoseconds(label.stamp_ns % kNanoseconds), 4);
  append(message, body.size(), 8);
  append(message, checksum(body.data(), body.size()), 8);
  message.insert(message.end(), body.begin(), body.end());
  return message;
}

/// What the library packs, under our header.
template <typename MessagePointer>
Bytes finish(const Label& label, MessagePointer& message) {
  message->Pack();
  const auto* body = static_cast<const std::uint8_t*>(message->GetPackBodyPointer());
  return withHeader(1, message->GetDeviceType(), label, Bytes(body, body + message->GetPackBodySize()));
}

/// Size, axes and place of an image; matrix_mm maps (column, row, slice) to the link's space.
void place(::igtl::ImageMessage& message, const Eigen::Array3i& size, const Eigen::Matrix4d& matrix_mm, Axes axes) {
  message.SetDimensions(size[0], size[1], size[2]);
  message.SetEndian(::igtl::ImageMessage::ENDIAN_LITTLE);
  message.SetCoordinateSystem(axes == Axes::kRas ? ::igtl::ImageMessage::COORDINATE_RAS
                                                 : ::igtl::ImageMessage::COORDINATE_LPS);
  const Eigen::Matrix3d sides = matrix_mm.topLeftCorner<3, 3>();
  const Eigen::Vector3d spacing = sides.colwise().norm();
  message.SetSpacing(static_cast<float>(spacing[0]), static_cast<float>(spacing[1]), static_cast<float>(spacing[2]));
  // On the wire the origin is the centre of the image, not its first pixel.
  const Eigen::Vector3d middle = (size.cast<double>() - 1) / 2;
  const Eigen::Vector3d centre = sides * middle + matrix_mm.topRightCorner<3, 1>();
  ::igtl::Matrix4x4 matrix;
  ::igtl::IdentityMatrix(matrix);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column)
      matrix[row][column] = static_cast<float>(sides(row, column) / spacing[column]);
    matrix[row][3] = static_cast<float>(centre[row]);
  }
  message.SetMatrix(matrix);
}

}  // namespace

Bytes composeImage(const Label& label, const Picture& picture, const Eigen::Matrix4d& matrix_mm, Axes axes) {
  const std::lock_guard<std::mutex> lock(library_mutex);
  auto message = ::igtl::ImageMessage::New();
  message->SetNumComponents(picture.channels);
  message->SetScalarTypeToUint8();
  place(*message, {picture.columns, picture.rows, 1}, matrix_mm, axes);
  message->AllocateScalars();
  const std::size_t size = static_cast<std::size_t>(picture.rows) * static_cast<std::size_t>(picture.columns) *
                           static_cast<std::size_t>(picture.channels);
  std::copy(picture.pixels, picture.pixels + size, static_cast<std::uint8_t*>(message->GetScalarPointer()));
  return finish(label, message);
}

Bytes composeVolume(const Label& label, const Voxels& voxels, const Eigen::Matrix4d& matrix_mm, Axes axes) {
  constexpr int kMost = 65535;  // a side, as the protocol has it
  for (const int side : {voxels.columns, voxels.rows, voxels.slices})
    if (side < 1 || side > kMost)
      throw std::invalid_argument("a side of the volume has " + std::to_string(side) + " voxels");
  const std::lock_guard<std::mutex> lock(library_mutex);
  auto message = ::igtl::ImageMessage::New();
  message->SetNumComponents(1);
  message->SetScalarType(::igtl::ImageMessage::TYPE_FLOAT32);
  place(*message, {voxels.columns, voxels.rows, voxels.slices}, matrix_mm, axes);
  message->AllocateScalars();
  const std::size_t size = static_cast<std::size_t>(voxels.columns) * static_cast<std::size_t>(voxels.rows) *
                           static_cast<std::size_t>(voxels.slices);
  std::memcpy(message->GetScalarPointer(), voxels.values, size * sizeof(float));
  return finish(label, message);
}

Bytes composeString(const Label& label, const std::string& text) {
  const std::lock_guard<std::mutex> lock(library_mutex);
  auto message = ::igtl::StringMessage::New();
  std::string cut = text.substr(0, 65535);
  message->SetEncoding(kUtf8);
  message->SetString(cut);
  return finish(label, message);
}

Bytes composeStatus(const Label& label, int code, const std::string& text) {
  const std::lock_guard<std::mutex> lock(library_mutex);
  auto message = ::igtl::StatusMessage::New();
  message->SetCode(code);
  message->SetSubCode(0);
  message->SetErrorName(code == 1 ? "OK" : "Error");
  message->SetStatusString(text.c_str());
  return finish(label, message);
}

Bytes composeStartTracking(const Label& label, int period_ms) {
  const std::lock_guard<std::mutex> lock(library_mutex);
  auto message = ::igtl::StartTrackingDataMessage::New();
  message->SetResolution(period_ms);
  return finish(label, message);
}

// By hand, because the library's own packing crashes on larger meshes: it was built to write to unaligned memory as if
// it were aligned.
Bytes composePolyData(const Label& label, const LinkMesh& mesh) {
  const std::vector<Attribute> attributes = attributesOf(mesh);
  const std::size_t cell_bytes = mesh.cells.size() * 5 * 4;
  Bytes body;
  body.reserve(40 + mesh.points_mm.size() * 12 + cell_bytes + mesh.points_mm.size() * 32 + 128);
  append(body, mesh.points_mm.size(), 4);
  append(body, 0, 16);  // vertices and lines: number and bytes of each
  append(body, mesh.cells.size(), 4);
  append(body, cell_bytes, 4);
  append(body, 0, 8);  // triangle strips
  append(body, attributes.size(), 4);
  append(body, mesh.points_mm);
  for (const auto& cell : mesh.cells) {
    append(body, cell.size(), 4);
    for (const std::uint32_t corner : cell) append(body, corner, 4);
  }
  std::size_t names = 0;
  for (const Attribute& attribute : attributes) {
    append(body, static_cast<std::uint64_t>(attribute.type), 1);
    append(body, static_cast<std::uint64_t>(attribute.components), 1);
    append(body, mesh.points_mm.size(), 4);
    names += attribute.name.size() + 1;
  }
  for (const Attribute& attribute : attributes) appendText(body, attribute.name, attribute.name.size() + 1);
  if (names % 2 == 1) append(body, 0, 1);
  for (const Attribute& attribute : attributes) body.insert(body.end(), attribute.data.begin(), attribute.data.end());
  return withHeader(1, "POLYDATA", label, body);
}

// By hand, because the library's own array leaks and is freed by the wrong delete.
Bytes composeArray(const Label& label, const std::vector<double>& values) {
  Bytes body;
  append(body, 11, 1);  // float64
  append(body, 1, 1);   // dimensions
  append(body, values.size(), 2);
  for (const double value : values) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof bits);
    append(body, bits, 8);
  }
  return withHeader(1, "NDARRAY", label, body);
}

// By hand, because Debian's library ends at protocol version 2; COMMAND and metadata came with version 3.
Bytes composeCommandReply(const Label& label, const Command& command, bool success, const std::string& text) {
  const std::string key = "Status", value = success ? "SUCCESS" : "FAIL";
  Bytes body;
  append(body, 12, 2);                         // size of this extended header
  append(body, 2 + 8, 2);                      // metadata index
  append(body, key.size() + value.size(), 4);  // metadata
  append(body, command.id, 4);                 // message id
  append(body, command.id, 4);
  appendText(body, command.name, 128);
  append(body, kUtf8, 2);
  append(body, text.size(), 4);
  appendText(body, text, text.size());
  append(body, 1, 2);
  append(body, key.size(), 2);
  append(body, 3, 2);  // US-ASCII
  append(body, value.size(), 4);
  appendText(body, key, key.size());
  appendText(body, value, value.size());
  return withHeader(2, "RTS_COMMAND", label, body);
}

}  // namespace cortshift_tracking::igt
