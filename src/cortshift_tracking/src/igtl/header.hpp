// What the header of every OpenIGTLink message is made of: sizes, time, checksum.
#pragma once

#include <igtl_util.h>

#include <cstddef>
#include <cstdint>

namespace cortshift_tracking::igt {

constexpr std::size_t kTypeSize = 12;
constexpr std::int64_t kNanoseconds = 1000000000;  // in a second

/// The protocol counts parts of a second in units of 2^-32 s.
inline std::uint32_t fractionFromNanoseconds(std::int64_t part_ns) {
  return static_cast<std::uint32_t>((static_cast<std::uint64_t>(part_ns) << 32) / kNanoseconds);
}
inline std::int64_t nanosecondsFromFraction(std::uint32_t fraction) {
  return static_cast<std::int64_t>((std::uint64_t{fraction} * kNanoseconds) >> 32);
}

inline std::uint64_t checksum(const std::uint8_t* body, std::size_t size) {
  return ::crc64(const_cast<unsigned char*>(body), size, 0);  // the library does not write to it
}

}  // namespace cortshift_tracking::igt
