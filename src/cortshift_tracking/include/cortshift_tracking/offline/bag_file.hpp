// A recorded bag by its index alone: where each message lies, and only those messages that are asked for.
#pragma once

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <ros/time.h>

#include <boost/make_shared.hpp>
#include <cstdint>
#include <filesystem>
#include <list>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

struct BagTopic {
  std::string name, type, md5sum;
  bool latching = false;
  std::uint64_t messages = 0;  ///< of the whole bag
};

/// Where a message lies.
struct BagEntry {
  ros::Time time;            ///< when it was recorded
  std::uint64_t chunk = 0;   ///< place of its chunk in the file
  std::uint32_t offset = 0;  ///< within the uncompressed chunk
  std::uint32_t topic = 0;   ///< place in BagFile::topics()

  bool operator<(const BagEntry& other) const {
    return std::tie(time, chunk, offset) < std::tie(other.time, other.chunk, other.offset);
  }
};

/// ROS bag format 2.0, read without the index of every message that rosbag::Bag keeps in memory: 40 bytes are kept for
/// each chunk (usually 768 kB or more), one uncompressed chunk at a time, and messages are read one by one.
///
/// A bag without an index (it was not closed, or is cut) is walked through from chunk to chunk; what its last chunk
/// lacks is left out and said in remarks(). Chunks may overlap in time and messages may stand in any order. Neither
/// copied nor changed. Not synchronised.
class BagFile {
 public:
  /// @param wanted  topics whose messages may be asked for, at most 64
  /// @throws TrackingError naming the file, what is wrong and the remedy
  BagFile(const std::filesystem::path& path, const std::vector<std::string>& wanted);
  ~BagFile();
  BagFile(const BagFile&) = delete;
  BagFile& operator=(const BagFile&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const { return size_; }

  /// Times of the first and the last message of any topic. @throws TrackingError for a bag without messages
  ros::Time begin() const;
  ros::Time end() const;

  /// Everything in the bag, wanted or not.
  const std::vector<BagTopic>& topics() const { return topics_; }

  /// Messages of `name` in the whole bag.
  std::uint64_t messages(const std::string& name) const;

  /// How its chunks are compressed: none, bz2, lz4, each with their number.
  const std::map<std::string, std::uint64_t>& compressions() const { return compressions_; }

  /// What is wrong with the file and was worked around.
  const std::vector<std::string>& remarks() const { return remarks_; }

  /// Messages of wanted topics recorded within [from, to], in order of time.
  std::vector<BagEntry> entries(const std::vector<std::string>& names, const ros::Time& from,
                                const ros::Time& to) const;

  /// The last `count` messages of a wanted topic not recorded after `time`, the latest first.
  std::vector<BagEntry> lastBefore(const std::string& name, const ros::Time& time, std::size_t count = 1) const;

  const std::string& topicOf(const BagEntry& entry) const { return topics_[entry.topic].name; }

  /// Stamp in the header of a message that begins with one. @throws TrackingError
  ros::Time stampOf(const BagEntry& entry) const;

  /// @throws TrackingError if the message is of another type or damaged
  template <typename Message>
  boost::shared_ptr<Message const> read(const BagEntry& entry) const {
    requireType(entry, ros::message_traits::datatype<Message>(), ros::message_traits::md5sum<Message>());
    std::string bytes = message(entry, kWhole);
    auto out = boost::make_shared<Message>();
    try {
      ros::serialization::IStream stream(reinterpret_cast<std::uint8_t*>(&bytes[0]),
                                         static_cast<std::uint32_t>(bytes.size()));
      ros::serialization::deserialize(stream, *out);
    } catch (const std::exception& error) {
      refuse(entry, error.what());
    }
    return out;
  }

 private:
  static constexpr std::uint32_t kWhole = 0xffffffff;

  struct Connection {
    std::size_t topic = 0;
    std::optional<unsigned> bit;  // of the chunks' mask; none: not wanted
  };
  struct Chunk {
    std::uint64_t position = 0;
    ros::Time begin, end;
    std::uint64_t mask = 0;  // wanted topics in it
  };
  struct ChunkHead {
    std::uint64_t data = 0;    // place of the data in the file
    std::uint32_t stored = 0;  // bytes there
    std::uint32_t size = 0;    // bytes uncompressed
    std::string compression;
  };
  struct ChunkIndex {
    std::uint32_t connection = 0;
    std::uint64_t data = 0;
    std::uint32_t data_size = 0;
  };
  struct Record {
    std::map<std::string, std::string> fields;
    std::uint64_t data = 0;
    std::uint32_t data_size = 0;

    std::uint64_t next() const { return data + data_size; }
  };

  std::string bytes(std::uint64_t position, std::uint64_t count) const;
  Record record(std::uint64_t position) const;
  ChunkHead chunkHead(std::uint64_t position) const;
  void readHeader();
  bool readIndex(std::uint64_t position, std::uint32_t connections, std::uint32_t chunks);
  void walk();
  void addConnection(const Record& head, const std::string& data);
  void scanChunk(const ChunkHead& head, Chunk& chunk);
  std::vector<ChunkIndex> indexRecords(const ChunkHead& head) const;
  void indexOfChunk(const Chunk& chunk, std::uint64_t mask, const ros::Time& from, const ros::Time& to,
                    std::vector<BagEntry>& out) const;
  const std::string& uncompressed(std::uint64_t chunk) const;
  std::string message(const BagEntry& entry, std::uint32_t at_most) const;
  void requireType(const BagEntry& entry, const std::string& type, const std::string& md5sum) const;
  std::uint64_t maskOf(const std::vector<std::string>& names) const;
  [[noreturn]] void refuse(const BagEntry& entry, const std::string& reason) const;

  std::filesystem::path path_;
  std::vector<std::string> wanted_;
  int file_ = -1;
  std::uint64_t size_ = 0;
  std::uint64_t first_record_ = 0;
  std::map<std::uint32_t, Connection> connections_;
  std::vector<BagTopic> topics_;
  std::vector<Chunk> chunks_;  // in the order of the file
  ros::Time begin_, end_;
  std::map<std::string, std::uint64_t> compressions_;
  std::vector<std::string> remarks_;
  // Compressed messages of one chunk are often asked for together; a pair may lie across two.
  mutable std::list<std::pair<std::uint64_t, std::string>> cache_;
};

}  // namespace cortshift_tracking
