// What libopenigtlink packs, our reader must understand; what our composer sends, libopenigtlink must.
#include "cortshift_tracking/igtl/wire.hpp"

#include <gtest/gtest.h>
#include <igtlImageMessage.h>
#include <igtlPolyDataMessage.h>
#include <igtlPositionMessage.h>
#include <igtlStatusMessage.h>
#include <igtlStringMessage.h>
#include <igtlTrackingDataMessage.h>
#include <igtlTransformMessage.h>
#include <igtl_util.h>

#include <cstring>

#include "cortshift_tracking/igtl/compose.hpp"
#include "packets.hpp"

namespace cortshift_tracking::igt {
namespace {

template <typename MessagePointer>
Bytes pack(MessagePointer& message, const char* device) {
  message->SetDeviceName(device);
  message->SetTimeStamp(1700000000, 1u << 31);  // and a half second
  message->Pack();
  const auto* data = static_cast<const std::uint8_t*>(message->GetPackPointer());
  return {data, data + message->GetPackSize()};
}

Message decodeOne(const Bytes& bytes) {
  StreamDecoder decoder(1 << 20);
  decoder.append(bytes.data(), bytes.size());
  const auto message = decoder.next();
  EXPECT_TRUE(message);
  EXPECT_FALSE(decoder.holdsPart());
  return message.value_or(Message{});
}

/// Lets the library read what we composed.
template <typename MessagePointer>
void unpack(const Bytes& bytes, MessagePointer& message) {
  auto header = ::igtl::MessageHeader::New();
  header->InitPack();
  std::memcpy(header->GetPackPointer(), bytes.data(), kHeaderSize);
  header->Unpack();
  message->SetMessageHeader(header);
  message->AllocatePack();
  ASSERT_EQ(message->GetPackBodySize(), static_cast<int>(bytes.size() - kHeaderSize));
  std::memcpy(message->GetPackBodyPointer(), bytes.data() + kHeaderSize, bytes.size() - kHeaderSize);
  ASSERT_TRUE(message->Unpack(1) & ::igtl::MessageHeader::UNPACK_BODY);
}

void fillMatrix(::igtl::Matrix4x4& matrix) {
  ::igtl::IdentityMatrix(matrix);
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column) matrix[row][column] = static_cast<float>(10 * row + column) + 0.5F;
}

TEST(Wire, Transform) {
  auto sent = ::igtl::TransformMessage::New();
  ::igtl::Matrix4x4 matrix;
  fillMatrix(matrix);
  sent->SetMatrix(matrix);
  const Message message = decodeOne(pack(sent, "Microscope"));
  EXPECT_EQ(message.stamp_ns, 1700000000500000000);
  const auto samples = decodePoses(message);
  ASSERT_EQ(samples.size(), 1u);
  EXPECT_EQ(samples[0].tool, "Microscope");
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column) EXPECT_EQ((*samples[0].matrix_mm)(row, column), matrix[row][column]);
}

TEST(Wire, TrackingData) {
  auto sent = ::igtl::TrackingDataMessage::New();
  ::igtl::Matrix4x4 matrix;
  fillMatrix(matrix);
  const int kinds[] = {::igtl::TrackingDataElement::TYPE_6D, ::igtl::TrackingDataElement::TYPE_5D};
  for (const int kind : kinds) {
    auto element = ::igtl::TrackingDataElement::New();
    element->SetName(kind == kinds[0] ? "Whole" : "NoRoll");
    element->SetType(static_cast<igtlUint8>(kind));
    element->SetMatrix(matrix);
    sent->AddTrackingDataElement(element);
  }
  const auto samples = decodePoses(decodeOne(pack(sent, "Tracker")));
  ASSERT_EQ(samples.size(), 2u);
  EXPECT_EQ(samples[0].tool, "Whole");
  EXPECT_EQ((*samples[0].matrix_mm)(2, 3), matrix[2][3]);
  EXPECT_FALSE(samples[1].matrix_mm);
}

TEST(Wire, Position) {
  auto sent = ::igtl::PositionMessage::New();
  sent->SetPosition(1, 2, 3);
  sent->SetQuaternion(0.5F, -0.5F, 0.5F, 0.5F);
  Message message = decodeOne(pack(sent, "Probe"));
  // The shorter kinds are the beginning of the whole one. The library writes beyond its own buffer when it packs them.
  constexpr std::size_t kAll = 28, kWithQuaternion3 = 24, kPositionOnly = 12;
  for (const std::size_t size : {kAll, kWithQuaternion3}) {
    message.content.resize(size);
    const auto samples = decodePoses(message);
    const Eigen::Matrix4d& matrix_mm = samples.at(0).matrix_mm.value();
    // (0.5, -0.5, 0.5; 0.5): x -> -y, y -> -z, z -> x
    EXPECT_LT((matrix_mm.col(0).head<3>() - Eigen::Vector3d(0, 0, 1)).norm() *
                  (matrix_mm.col(0).head<3>() - Eigen::Vector3d(0, -1, 0)).norm(),
              1e-6);
    const Eigen::Quaterniond expected(0.5, 0.5, -0.5, 0.5);
    EXPECT_LT((matrix_mm.topLeftCorner<3, 3>() - expected.toRotationMatrix()).norm(), 1e-6);
    EXPECT_EQ(matrix_mm.col(3), Eigen::Vector4d(1, 2, 3, 1));
  }
  message.content.resize(kPositionOnly);
  EXPECT_FALSE(decodePoses(message).at(0).matrix_mm);
}

TEST(Wire, StringAndStatus) {
  auto text = ::igtl::StringMessage::New();
  text->SetString("capture_stage dura_open");
  EXPECT_EQ(decodeString(decodeOne(pack(text, "cortshift"))), "capture_stage dura_open");
  auto status = ::igtl::StatusMessage::New();
  status->SetCode(13);
  status->SetErrorName("NotReady");
  status->SetStatusString("warming up");
  const Status read = decodeStatus(decodeOne(pack(status, "Tracker")));
  EXPECT_EQ(read.code, 13);
  EXPECT_EQ(read.text, "warming up");
}

TEST(Wire, ExtendedHeaderAndMetadata) {
  const Bytes content = transformContent(Eigen::Matrix4d::Identity());
  const Message ok = decodeOne(packetV2("TRANSFORM", "M", 1, content, {{"Status", "OK"}}));
  EXPECT_EQ(ok.content, content);
  EXPECT_EQ(ok.metadata.at("Status"), "OK");
  EXPECT_TRUE(decodePoses(ok).at(0).matrix_mm);
  for (const char* key : {"Status", "TransformStatus"}) {
    const auto samples = decodePoses(decodeOne(packetV2("TRANSFORM", "M", 1, content, {{key, "INVALID"}})));
    EXPECT_FALSE(samples.at(0).matrix_mm);
    EXPECT_NE(samples.at(0).reason.find("INVALID"), std::string::npos);
  }
}

TEST(Wire, CommandComesBackInItsReply) {
  const Command command{77, "capture_stage", "dura_open"};
  const Bytes reply = composeCommandReply({"CortshiftReply", 5000000000}, command, false, "no such thing");
  const Message message = decodeOne(reply);
  EXPECT_EQ(message.type, "RTS_COMMAND");
  EXPECT_EQ(message.metadata.at("Status"), "FAIL");
  const Command read = decodeCommand(message);
  EXPECT_EQ(read.id, 77u);
  EXPECT_EQ(read.name, "capture_stage");
  EXPECT_EQ(read.text, "no such thing");
}

TEST(Wire, ByteByByteAndManyAtOnce) {
  Bytes stream;
  for (int i = 0; i < 5; ++i) {
    const Bytes one = composeString({"d", 1}, std::string(static_cast<std::size_t>(i) * 100, 'x'));
    stream.insert(stream.end(), one.begin(), one.end());
  }
  StreamDecoder slow(1000), fast(1000);
  std::size_t messages = 0;
  for (const std::uint8_t byte : stream) {
    slow.append(&byte, 1);
    while (const auto message = slow.next()) EXPECT_EQ(decodeString(*message).size(), 100 * messages++);
  }
  EXPECT_EQ(messages, 5u);
  fast.append(stream.data(), stream.size());
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(decodeString(fast.next().value()).size(), 100 * i);
  EXPECT_FALSE(fast.next());
}

void expectRefused(const Bytes& bytes, const std::string& reason) {
  StreamDecoder decoder(1000);
  decoder.append(bytes.data(), bytes.size());
  try {
    decoder.next();
    ADD_FAILURE() << "accepted; expected: " << reason;
  } catch (const ProtocolError& error) {
    EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
  }
}

TEST(Wire, RefusesBrokenMessages) {
  const Bytes good = packetV1("TRANSFORM", "M", 1, transformContent(Eigen::Matrix4d::Identity()));
  Bytes bad = good;
  bad.back() ^= 1;
  expectRefused(bad, "checksum");
  bad = good;
  bad[1] = 9;
  expectRefused(bad, "version");
  bad = good;
  bad[2] = '\n';
  expectRefused(bad, "type");
  bad = good;
  bad[14] = '\n';
  expectRefused(bad, "control");
  bad = good;
  bad[42] = 0x7f;  // of the body's size
  expectRefused(bad, "announces");
  // Lengths within the extended header that lead outside.
  Bytes body(12, 0);
  body[1] = 200;
  expectRefused(packet(2, "TRANSFORM", "M", 1, body), "too short");
  body[1] = 12;
  body[4] = body[5] = body[6] = body[7] = 0xff;
  expectRefused(packet(2, "TRANSFORM", "M", 1, body), "metadata");
}

TEST(Wire, TakesEveryLetterAndDigitInATypeAndNothingElse) {
  for (const char* type : {"ABC_019", "XYZ", "9", "A"}) {
    const Bytes bytes = packetV1(type, "M", 1, {});
    StreamDecoder decoder(1000);
    decoder.append(bytes.data(), bytes.size());
    const auto message = decoder.next();
    ASSERT_TRUE(message) << type;
    EXPECT_EQ(message->type, type);
  }
  for (const char* type : {"transform", "A-B", "A B", "A:", "A/", "A@", "A["})
    expectRefused(packetV1(type, "M", 1, {}), "message type");
}

TEST(Wire, RefusesContentOfTheWrongForm) {
  for (const char* type : {"TRANSFORM", "POSITION", "TDATA"})
    for (const std::size_t size : {1u, 47u, 49u, 71u, 100u}) {
      Message message;
      message.type = type;
      message.content.assign(size, 0);
      EXPECT_THROW(decodePoses(message), ProtocolError) << type << size;
    }
  Message text;
  text.type = "STRING";
  text.content = {0, 3, 0xff, 0xff, 'a'};
  EXPECT_THROW(decodeString(text), ProtocolError);
  text.content.assign(138, 0);
  text.content[134] = 0xff;  // of the length
  EXPECT_THROW(decodeCommand(text), ProtocolError);
}

TEST(Compose, PolyDataIsReadByTheLibrary) {
  LinkMesh mesh;
  for (int i = 0; i < 4; ++i) {
    mesh.points_mm.emplace_back(i, 2 * i, -3 * i);
    mesh.displacements_mm.emplace_back(0.25F * static_cast<float>(i), 1, 2);
    mesh.confidence.push_back(0.1F * static_cast<float>(i));
    mesh.colours_rgb.emplace_back(1, 0.5F, 0);
  }
  mesh.cells.push_back({0, 1, 3, 2});
  auto read = ::igtl::PolyDataMessage::New();
  unpack(composePolyData({"ShiftField", 1}, mesh), read);
  ASSERT_EQ(read->GetPoints()->GetNumberOfPoints(), 4);
  igtlFloat32 point[3];
  read->GetPoints()->GetPoint(3, point);
  EXPECT_EQ(point[2], -9);
  ASSERT_EQ(read->GetPolygons()->GetNumberOfCells(), 1u);
  ASSERT_EQ(read->GetNumberOfAttributes(), 3);
  EXPECT_STREQ(read->GetAttribute(0)->GetName(), "displacement");
  EXPECT_EQ(read->GetAttribute(0)->GetType(), ::igtl::PolyDataAttribute::POINT_VECTOR);
  igtlFloat32 vector[3];
  read->GetAttribute(0)->GetNthData(3, vector);
  EXPECT_EQ(vector[0], 0.75F);
}

TEST(Compose, ImageLiesWhereItsMatrixSays) {
  const std::vector<std::uint8_t> pixels = {1, 2, 3, 4, 5, 6};
  Eigen::Matrix4d matrix_mm = Eigen::Matrix4d::Identity();
  matrix_mm.topLeftCorner<3, 3>() = Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  matrix_mm.topLeftCorner<3, 2>() *= 0.1;
  matrix_mm.topRightCorner<3, 1>() << 10, 20, 30;
  auto read = ::igtl::ImageMessage::New();
  unpack(composeImage({"FieldTexture", 1}, {2, 3, 1, pixels.data()}, matrix_mm, Axes::kLps), read);
  int size[3];
  read->GetDimensions(size);
  EXPECT_EQ(size[0], 3);
  EXPECT_EQ(size[1], 2);
  EXPECT_EQ(read->GetCoordinateSystem(), ::igtl::ImageMessage::COORDINATE_LPS);
  ::igtl::Matrix4x4 centre;
  read->GetMatrix(centre);
  const Eigen::Vector4d expected = matrix_mm * Eigen::Vector4d(1, 0.5, 0, 1);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(centre[i][3], expected[i], 1e-5);
  float spacing[3];
  read->GetSpacing(spacing);
  EXPECT_NEAR(spacing[0], 0.1, 1e-6);
  EXPECT_EQ(static_cast<std::uint8_t*>(read->GetScalarPointer())[5], 6);
}

TEST(Compose, RefusesLongNames) {
  EXPECT_THROW(composeString({std::string(21, 'x'), 1}, ""), std::invalid_argument);
  EXPECT_THROW(composeArray({std::string(21, 'x'), 1}, {}), std::invalid_argument);
}

}  // namespace
}  // namespace cortshift_tracking::igt
