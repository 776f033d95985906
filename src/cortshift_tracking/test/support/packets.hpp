// OpenIGTLink messages put together byte by byte for the tests, after the protocol's own description.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "cortshift_tracking/igtl/wire.hpp"

namespace cortshift_tracking::igt {

inline void put(Bytes& out, std::uint64_t value, int size) {
  for (int shift = 8 * (size - 1); shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

inline void put(Bytes& out, const std::string& text, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) out.push_back(i < text.size() ? static_cast<std::uint8_t>(text[i]) : 0);
}

/// CRC-64 with the ECMA-182 polynomial, bit by bit.
inline std::uint64_t checksum(const Bytes& bytes) {
  std::uint64_t crc = 0;
  for (const std::uint8_t byte : bytes) {
    crc ^= static_cast<std::uint64_t>(byte) << 56;
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 63 ? crc << 1 ^ 0x42F0E1EBA9EA3693 : crc << 1;
  }
  return crc;
}

inline Bytes packet(int version, const std::string& type, const std::string& device, std::int64_t stamp_ns,
                    const Bytes& body) {
  Bytes out;
  put(out, static_cast<std::uint64_t>(version), 2);
  put(out, type, 12);
  put(out, device, 20);
  put(out, static_cast<std::uint64_t>(stamp_ns / 1000000000), 4);
  put(out, static_cast<std::uint64_t>(static_cast<double>(stamp_ns % 1000000000) * 4.294967296 + 0.5), 4);
  put(out, body.size(), 8);
  put(out, checksum(body), 8);
  out.insert(out.end(), body.begin(), body.end());
  return out;
}

inline Bytes packetV1(const std::string& type, const std::string& device, std::int64_t stamp_ns, const Bytes& content) {
  return packet(1, type, device, stamp_ns, content);
}

inline Bytes packetV2(const std::string& type, const std::string& device, std::int64_t stamp_ns, const Bytes& content,
                      const std::map<std::string, std::string>& metadata) {
  Bytes index, values, body;
  put(index, metadata.size(), 2);
  for (const auto& [key, value] : metadata) {
    put(index, key.size(), 2);
    put(index, 3, 2);
    put(index, value.size(), 4);
    put(values, key, key.size());
    put(values, value, value.size());
  }
  put(body, 12, 2);
  put(body, index.size(), 2);
  put(body, values.size(), 4);
  put(body, 0, 4);
  for (const Bytes& part : {content, index, values}) body.insert(body.end(), part.begin(), part.end());
  return packet(2, type, device, stamp_ns, body);
}

inline Bytes transformContent(const Eigen::Matrix4d& matrix_mm) {
  Bytes out;
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 3; ++row) {
      const auto value = static_cast<float>(matrix_mm(row, column));
      std::uint32_t bits = 0;
      std::memcpy(&bits, &value, sizeof bits);
      put(out, bits, 4);
    }
  return out;
}

}  // namespace cortshift_tracking::igt
