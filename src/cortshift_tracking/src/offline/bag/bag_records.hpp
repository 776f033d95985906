// A bag's file: bytes, records and chunks at a place, none of them larger than the file is.
#pragma once

#include <cstdint>
#include <filesystem>
#include <list>
#include <string>
#include <utility>
#include <vector>

#include "offline/bag/bag_format.hpp"

namespace cortshift_tracking::bag {

struct Record {
  Fields fields;
  std::uint64_t data = 0;  ///< place in the file
  std::uint32_t data_size = 0;

  std::uint64_t next() const { return data + data_size; }
};

struct ChunkHead {
  std::uint64_t data = 0;    ///< place of the data in the file
  std::uint32_t stored = 0;  ///< bytes there
  std::uint32_t size = 0;    ///< bytes uncompressed
  std::string compression;

  std::uint64_t next() const { return data + stored; }
};

/// Where the messages of one connection lie in one chunk.
struct ChunkIndex {
  struct Message {
    ros::Time time;
    std::uint32_t offset = 0;  ///< within the uncompressed chunk
  };
  std::uint32_t connection = 0;
  std::uint64_t data = 0;
  std::uint32_t count = 0;  ///< messages
};

class BagRecords {
 public:
  /// @throws TrackingError if the file cannot be read
  explicit BagRecords(const std::filesystem::path& path);
  ~BagRecords();
  BagRecords(const BagRecords&) = delete;
  BagRecords& operator=(const BagRecords&) = delete;

  std::uint64_t size() const { return size_; }

  // All of these throw FormatError where the file is not as the format says, TrackingError where it cannot be read.
  std::string bytes(std::uint64_t position, std::uint64_t count) const;
  Record record(std::uint64_t position) const;
  ChunkHead chunkHead(std::uint64_t position) const;

  /// What follows a chunk; none where the file is cut within.
  std::vector<ChunkIndex> indexesAfter(const ChunkHead& head) const;
  std::vector<ChunkIndex::Message> messagesOf(const ChunkIndex& index) const;

  /// The last chunks asked for are kept.
  const std::string& content(std::uint64_t chunk, const ChunkHead& head) const;

 private:
  std::filesystem::path path_;
  int file_ = -1;
  std::uint64_t size_ = 0;
  // Compressed messages of one chunk are often asked for together; a pair may lie across two.
  mutable std::list<std::pair<std::uint64_t, std::string>> cache_;
};

}  // namespace cortshift_tracking::bag
