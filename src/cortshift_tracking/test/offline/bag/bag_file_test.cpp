// A damaged bag is refused with its name and the remedy, or what is whole of it is read: nothing else may happen.
#include "cortshift_tracking/offline/bag/bag_file.hpp"

#include <cortshift_msgs/MicroscopeSettings.h>
#include <gmock/gmock.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CameraInfo.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <random>

namespace cortshift_tracking {
namespace {

using ::testing::HasSubstr;

const std::vector<std::string> kTopics = {"/microscope/settings", "/stereo/left/camera_info", "/tf"};

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "bag_file_XXXXXX").string();
    if (::mkdtemp(&name[0]) == nullptr) throw std::runtime_error("no temporary folder");
    path_ = name;
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

std::string contentOf(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Two dozen messages of three topics in a few chunks.
std::string smallBag(const std::filesystem::path& path, rosbag::CompressionType compression) {
  rosbag::Bag bag(path.string(), rosbag::bagmode::Write);
  bag.setCompression(compression);
  bag.setChunkThreshold(2000);
  for (int i = 0; i < 8; ++i) {
    const ros::Time time(100 + i, 5);
    cortshift_msgs::MicroscopeSettings settings;
    settings.header.stamp = time;
    settings.header.frame_id = "microscope";
    settings.magnification = 1 + i;
    bag.write(kTopics[0], time, settings);
    sensor_msgs::CameraInfo info;
    info.header.stamp = time;
    info.distortion_model = "plumb_bob";
    info.D = {0.1, 0.2, 0.3, 0.4, 0.5};
    bag.write(kTopics[1], time, info);
    tf2_msgs::TFMessage tf;
    tf.transforms.resize(2);
    tf.transforms[0].header.stamp = time;
    tf.transforms[1].child_frame_id = "microscope";
    bag.write(kTopics[2], time, tf);
  }
  bag.close();
  return contentOf(path);
}

struct Outcome {
  std::string contents;  ///< every message, serialised
  std::string refusal;
  std::size_t remarks = 0;
};

template <typename Message>
void append(const BagFile& bag, const BagEntry& entry, std::string& out) {
  const auto message = bag.read<Message>(entry);
  std::string bytes(ros::serialization::serializationLength(*message), '\0');
  ros::serialization::OStream stream(reinterpret_cast<std::uint8_t*>(&bytes[0]),
                                     static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, *message);
  out += std::to_string(entry.time.toNSec()) + bag.topicOf(entry) + bytes;
}

/// Everything that is ever asked of a bag. Lets every other exception than TrackingError through.
Outcome readAll(const std::filesystem::path& path) {
  Outcome out;
  try {
    const BagFile bag(path, kTopics);
    out.remarks = bag.remarks().size();
    out.contents = std::to_string((bag.end() - bag.begin()).toNSec());
    for (const BagTopic& topic : bag.topics()) out.contents += topic.name + std::to_string(topic.messages);
    for (const BagEntry& entry : bag.entries({kTopics[0]}, ros::Time(), ros::TIME_MAX)) {
      append<cortshift_msgs::MicroscopeSettings>(bag, entry, out.contents);
      out.contents += std::to_string(bag.stampOf(entry).toNSec());
    }
    for (const BagEntry& entry : bag.entries({kTopics[1]}, bag.begin(), bag.end()))
      append<sensor_msgs::CameraInfo>(bag, entry, out.contents);
    for (const BagEntry& entry : bag.lastBefore(kTopics[2], bag.end() + ros::Duration(1), 5))
      append<tf2_msgs::TFMessage>(bag, entry, out.contents);
  } catch (const TrackingError& error) {
    out.refusal = error.what();
  }
  return out;
}

/// Where a number stands in the bag, and how many bytes it has.
struct Number {
  std::size_t at, size;
  std::string name;
};

template <typename T>
T numberIn(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

/// Every length, count, place and time of the records in [at, end), those within uncompressed chunks too.
void findNumbers(const std::string& bag, std::size_t at, std::size_t end, std::vector<Number>& out) {
  while (at < end) {
    const std::size_t fields_end = at + 4 + numberIn<std::uint32_t>(bag, at);
    out.push_back({at, 4, "length of a header"});
    bool plain = false, index = false, info = false;
    for (std::size_t field = at + 4; field < fields_end;) {
      const std::size_t length = numberIn<std::uint32_t>(bag, field);
      out.push_back({field, 4, "length of a field"});
      const std::string text = bag.substr(field + 4, length);
      const std::size_t equals = text.find('=');
      const std::string name = text.substr(0, equals);
      const std::size_t value = field + 4 + equals + 1, size = length - equals - 1;
      if (name == "compression" && text.substr(equals + 1) == "none") plain = true;
      if (name == "op") index = bag[value] == 4, info = bag[value] == 6;
      if (name.find("time") != std::string::npos) {
        out.push_back({value, 4, name + " [s]"});
        out.push_back({value + 4, 4, name + " [ns]"});
      } else if (size == 1 || size == 4 || size == 8) {
        out.push_back({value, size, name});
      }
      field += 4 + length;
    }
    out.push_back({fields_end, 4, "length of a record"});
    const std::size_t data = fields_end + 4, next = data + numberIn<std::uint32_t>(bag, fields_end);
    if (plain) findNumbers(bag, data, next, out);
    if (index || info)
      for (std::size_t number = data; number < next; number += 4) out.push_back({number, 4, "entry of an index"});
    at = next;
  }
}

class DamagedBag : public ::testing::TestWithParam<rosbag::CompressionType> {
 protected:
  void SetUp() override {
    whole_ = smallBag(folder_.path() / "whole.bag", GetParam());
    before_ = readAll(folder_.path() / "whole.bag");
    ASSERT_EQ(before_.refusal, "");
    ASSERT_EQ(before_.remarks, 0u);
  }
  Outcome read(const std::string& bytes) {
    const std::filesystem::path path = folder_.path() / "damaged.bag";
    std::ofstream(path, std::ios::binary | std::ios::trunc).write(bytes.data(), static_cast<long>(bytes.size()));
    const Outcome out = readAll(path);
    if (!out.refusal.empty()) {
      EXPECT_THAT(out.refusal, HasSubstr("damaged.bag"));
      EXPECT_THAT(out.refusal, ::testing::ContainsRegex("copy the recording again|give a .bag file|rosbag (fix|decrypt)"
                                                        "|record again"));
    }
    return out;
  }

  TemporaryFolder folder_;
  std::string whole_;
  Outcome before_;
};

TEST_P(DamagedBag, NumbersThatCannotBe) {
  std::vector<Number> numbers;
  findNumbers(whole_, 13, whole_.size(), numbers);
  ASSERT_GT(numbers.size(), 150u);
  int refused = 0;
  for (const Number& number : numbers)
    for (const std::uint64_t value : {std::uint64_t{0}, std::uint64_t{1}, std::uint64_t{0x7fffffff},
                                      std::uint64_t{0x80000000}, std::uint64_t{0x3fffffff}, ~std::uint64_t{0}}) {
      std::string damaged = whole_;
      std::memcpy(&damaged[number.at], &value, number.size);
      SCOPED_TRACE(number.name + " at byte " + std::to_string(number.at) + " is " + std::to_string(value));
      Outcome out;
      ASSERT_NO_THROW(out = read(damaged));
      refused += out.refusal.empty() ? 0 : 1;
      // What is neither refused nor remarked upon has lost nothing.
      if (out.refusal.empty() && out.remarks == 0) {
        EXPECT_EQ(out.contents, before_.contents);
      }
    }
  EXPECT_GT(refused, 100);
}

TEST_P(DamagedBag, BytesThatTurned) {
  std::mt19937 random(20);
  for (int i = 0; i < 3000; ++i) {
    std::string damaged = whole_;
    SCOPED_TRACE(i);
    for (int n = 1 + static_cast<int>(random() % 4); n > 0; --n)
      damaged[random() % damaged.size()] = static_cast<char>(random() % 256);
    ASSERT_NO_THROW(read(damaged));
  }
}

TEST_P(DamagedBag, CutAnywhere) {
  for (std::size_t size = 0; size < whole_.size(); size += size < 200 ? 1 : 13) {
    SCOPED_TRACE(size);
    Outcome out;
    ASSERT_NO_THROW(out = read(whole_.substr(0, size)));
    EXPECT_TRUE(!out.refusal.empty() || out.remarks > 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Compressions, DamagedBag,
                         ::testing::Values(rosbag::compression::Uncompressed, rosbag::compression::BZ2,
                                           rosbag::compression::LZ4));

TEST(BagFile, SaysWhereAndWhatToDo) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "case.bag";
  const std::string whole = smallBag(path, rosbag::compression::Uncompressed);
  const auto spoil = [&](const std::string& field, const std::string& value, std::size_t after = 0) {
    std::string damaged = whole;
    const std::size_t at = damaged.find(field, after);
    ASSERT_NE(at, std::string::npos);
    damaged.replace(at + field.size(), value.size(), value);
    std::ofstream(path, std::ios::binary | std::ios::trunc).write(damaged.data(), static_cast<long>(damaged.size()));
  };
  spoil("chunk_count=", "\xff\xff\xff\xff");
  const BagFile walked(path, kTopics);
  ASSERT_EQ(walked.remarks().size(), 1u);
  EXPECT_THAT(walked.remarks()[0], HasSubstr("its index is damaged"));
  EXPECT_THAT(walked.remarks()[0], HasSubstr("at byte " + std::to_string(whole.size())));
  EXPECT_EQ(walked.entries(kTopics, ros::Time(), ros::TIME_MAX).size(), 24u);

  // The connection that the first chunk's index names is one that the bag does not hold.
  const std::size_t first_index = whole.find("op=\x04");
  const std::size_t start = whole.rfind("conn=", first_index) > first_index - 40 ? first_index - 40 : first_index;
  spoil("conn=", std::string("\x63\0\0\0", 4), start);
  try {
    BagFile(path, kTopics).entries(kTopics, ros::Time(), ros::TIME_MAX);
    FAIL() << "a message of no connection was found";
  } catch (const TrackingError& error) {
    EXPECT_THAT(error.what(),
                HasSubstr("case.bag: the chunk at 0.000000 s is damaged (a message's connection is missing "
                          "at byte "));
    EXPECT_THAT(error.what(), HasSubstr("copy the recording again, or try `rosbag reindex` on a copy of it"));
  }
}

// A list in a message that says to be four thousand million long is refused before room is made for it.
TEST(BagFile, ListsAreNotLongerThanTheirMessage) {
  std::string bytes(8, '\xff');
  CheckedStream stream(reinterpret_cast<std::uint8_t*>(&bytes[0]), static_cast<std::uint32_t>(bytes.size()));
  std::vector<std::uint8_t> list;
  EXPECT_THROW(stream.next(list), ros::serialization::StreamOverrunException);
  EXPECT_EQ(list.capacity(), 0u);
}

}  // namespace
}  // namespace cortshift_tracking
