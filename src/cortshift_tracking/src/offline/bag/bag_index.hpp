// What a bag holds: its topics, and for each chunk the times and wanted topics in it.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_tracking/offline/bag/bag_file.hpp"
#include "offline/bag/bag_records.hpp"

namespace cortshift_tracking::bag {

struct Connection {
  std::size_t topic = 0;        ///< place in BagIndex::topics
  std::optional<unsigned> bit;  ///< of the chunks' mask; none: not wanted
};

struct Chunk {
  std::uint64_t position = 0;
  ros::Time begin, end;
  std::uint64_t mask = 0;  ///< wanted topics in it
};

/// From the index at the file's end; where there is none or it is damaged, from one chunk after the other.
class BagIndex {
 public:
  /// @throws TrackingError naming the file, what is wrong at which byte, and the remedy
  BagIndex(const BagRecords& records, const std::string& path, const std::vector<std::string>& wanted);

  /// @throws FormatError at `place` for a connection that the bag does not hold
  const Connection& connection(std::uint32_t id, const Place& place) const;

  std::vector<BagTopic> topics;
  std::vector<Chunk> chunks;  ///< in the order of the file
  ros::Time begin = ros::TIME_MAX, end;
  std::map<std::string, std::uint64_t> compressions;
  std::vector<std::string> remarks;

 private:
  void read(std::uint64_t position, std::uint32_t connections, std::uint32_t chunks);
  Chunk chunkOf(const Record& head, std::vector<std::uint64_t>& counts) const;
  void requireChunks();
  void walk(std::uint64_t position);
  Chunk scan(std::uint64_t position, const ChunkHead& head);
  void add(const Fields& head, const char* data, std::size_t size, const Place& place);

  const BagRecords& records_;
  const std::vector<std::string>& wanted_;
  std::map<std::uint32_t, Connection> connections_;
};

}  // namespace cortshift_tracking::bag
