// A recorded bag by its index alone: where each message lies, and only those messages that are asked for.
#pragma once

#include <ros/message_traits.h>
#include <ros/serialization.h>
#include <ros/time.h>

#include <boost/make_shared.hpp>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/offline/bag/checked_stream.hpp"

namespace cortshift_tracking {

namespace bag {
class BagRecords;
class BagIndex;
struct Chunk;
}  // namespace bag

extern const char* const kDamagedBagRemedy;  ///< what to do, at the end of a sentence

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
/// lacks is left out and said in remarks(). A length, count or place that does not fit the file is never followed.
/// Chunks may overlap in time and messages may stand in any order. Neither copied nor changed. Not synchronised.
class BagFile {
 public:
  /// @param wanted  topics whose messages may be asked for, at most 64
  /// @throws TrackingError naming the file, what is wrong and the remedy
  BagFile(const std::filesystem::path& path, const std::vector<std::string>& wanted);
  ~BagFile();
  BagFile(const BagFile&) = delete;
  BagFile& operator=(const BagFile&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const;

  /// Times of the first and the last message of any topic. @throws TrackingError for a bag without messages
  ros::Time begin() const;
  ros::Time end() const;

  /// Everything in the bag, wanted or not.
  const std::vector<BagTopic>& topics() const;

  /// Messages of `name` in the whole bag.
  std::uint64_t messages(const std::string& name) const;

  /// How its chunks are compressed: none, bz2, lz4, each with their number.
  const std::map<std::string, std::uint64_t>& compressions() const;

  /// What is wrong with the file and was worked around.
  const std::vector<std::string>& remarks() const;

  /// Messages of wanted topics recorded within [from, to], in order of time.
  std::vector<BagEntry> entries(const std::vector<std::string>& names, const ros::Time& from,
                                const ros::Time& to) const;

  /// The last `count` messages of a wanted topic not recorded after `time`, the latest first.
  std::vector<BagEntry> lastBefore(const std::string& name, const ros::Time& time, std::size_t count = 1) const;

  const std::string& topicOf(const BagEntry& entry) const;

  /// Stamp in the header of a message that begins with one. @throws TrackingError
  ros::Time stampOf(const BagEntry& entry) const;

  /// @throws TrackingError if the message is of another type or damaged
  template <typename Message>
  boost::shared_ptr<Message const> read(const BagEntry& entry) const {
    requireType(entry, ros::message_traits::datatype<Message>(), ros::message_traits::md5sum<Message>());
    std::string bytes = message(entry, kWhole);
    auto out = boost::make_shared<Message>();
    try {
      CheckedStream stream(reinterpret_cast<std::uint8_t*>(&bytes[0]), static_cast<std::uint32_t>(bytes.size()));
      ros::serialization::deserialize(stream, *out);
      if (stream.getLength() != 0) throw TrackingError("bytes are left over");
    } catch (const std::exception& error) {
      refuse(entry, error.what());
    }
    return out;
  }

 private:
  static constexpr std::uint32_t kWhole = 0xffffffff;

  void indexOfChunk(const bag::Chunk& chunk, std::uint64_t mask, const ros::Time& from, const ros::Time& to,
                    std::vector<BagEntry>& out) const;
  std::string message(const BagEntry& entry, std::uint32_t at_most) const;
  void requireType(const BagEntry& entry, const std::string& type, const std::string& md5sum) const;
  std::uint64_t maskOf(const std::vector<std::string>& names) const;
  double secondsIn(const ros::Time& time) const;  // since the bag's begin
  [[noreturn]] void refuse(const BagEntry& entry, const std::string& reason) const;

  std::filesystem::path path_;
  std::vector<std::string> wanted_;
  std::unique_ptr<bag::BagRecords> records_;
  std::unique_ptr<bag::BagIndex> index_;
};

}  // namespace cortshift_tracking
