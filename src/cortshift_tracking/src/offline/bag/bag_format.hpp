// The words of ROS bag format 2.0: fields of a record's header, times, records within a chunk, compression.
// http://wiki.ros.org/Bags/Format/2.0
#pragma once

#include <ros/time.h>

#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <string>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking::bag {

constexpr std::uint32_t kMaxHeader = 1u << 20;  ///< [bytes] larger ones are no header
constexpr std::uint32_t kMaxChunk = 1u << 30;   ///< [bytes] stored or uncompressed

enum Op : std::uint8_t { kMessage = 2, kBagHeader = 3, kIndex = 4, kChunk = 5, kChunkInfo = 6, kConnection = 7 };

/// Where in the file something stands, or where in the uncompressed content of a chunk.
struct Place {
  std::uint64_t byte = 0;
  std::optional<std::uint64_t> chunk;  ///< place of that chunk in the file

  Place operator+(std::uint64_t bytes) const { return {byte + bytes, chunk}; }
  std::string text() const;
};

/// A record that does not keep the format; where it is met decides what that means.
class FormatError : public TrackingError {
 public:
  FormatError(const std::string& what, const Place& place) : TrackingError(what + " " + place.text()) {}
};

/// Little-endian, as the format and every machine that ROS 1 runs on.
template <typename T>
T numberAt(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

/// @throws FormatError for more than 999,999,999 ns: ros::Time would count on with them
ros::Time timeAt(const char* bytes, const Place& place);

/// The header of a record.
class Fields {
 public:
  Fields() = default;
  /// @throws FormatError
  Fields(const char* bytes, std::size_t size, const Place& place);

  /// @throws FormatError if it is missing or of another size
  template <typename T>
  T number(const char* name) const {
    return numberAt<T>(sized(name, sizeof(T)));
  }
  ros::Time time(const char* name) const { return timeAt(sized(name, 8), place_); }
  std::uint8_t op() const { return number<std::uint8_t>("op"); }
  std::string text(const char* name) const;  ///< empty where it is missing
  const Place& place() const { return place_; }

 private:
  const char* sized(const char* name, std::size_t size) const;

  std::map<std::string, std::string> values_;
  Place place_;
};

/// A record within an uncompressed chunk.
struct InnerRecord {
  Fields fields;
  const char* data = nullptr;
  std::uint32_t data_size = 0;
  std::size_t next = 0;
};

/// @param chunk  place of the chunk in the file  @throws FormatError
InnerRecord innerRecord(const std::string& content, std::size_t at, std::uint64_t chunk);

/// @param size  that the content must have  @throws FormatError
std::string uncompress(const std::string& stored, const std::string& compression, std::uint32_t size,
                       const Place& place);

std::string megabytes(std::uint64_t bytes);

}  // namespace cortshift_tracking::bag
