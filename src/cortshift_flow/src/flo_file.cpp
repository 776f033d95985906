#include "cortshift_flow/flo_file.hpp"

#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <vector>

namespace cortshift_flow {
namespace {

constexpr char kMagic[4] = {'P', 'I', 'E', 'H'};
constexpr std::int32_t kLargestSide = 65535;

// The file is little endian whatever the machine is.
std::uint32_t fromLittleEndian(const unsigned char* bytes) {
  return bytes[0] | bytes[1] << 8 | bytes[2] << 16 | static_cast<std::uint32_t>(bytes[3]) << 24;
}

void toLittleEndian(std::uint32_t value, unsigned char* bytes) {
  for (int i = 0; i < 4; ++i) bytes[i] = static_cast<unsigned char>(value >> (8 * i));
}

}  // namespace

void writeFlo(const std::string& path, const cv::Mat& flow) {
  if (flow.type() != CV_32FC2) throw std::invalid_argument("writeFlo: the flow is not CV_32FC2");
  std::ofstream file(path, std::ios::binary);
  std::array<unsigned char, 12> header;
  std::memcpy(header.data(), kMagic, 4);
  toLittleEndian(static_cast<std::uint32_t>(flow.cols), &header[4]);
  toLittleEndian(static_cast<std::uint32_t>(flow.rows), &header[8]);
  file.write(reinterpret_cast<const char*>(header.data()), header.size());
  std::vector<unsigned char> row(static_cast<std::size_t>(flow.cols) * 8);
  for (int y = 0; y < flow.rows && file; ++y) {
    for (int i = 0; i < 2 * flow.cols; ++i) {
      std::uint32_t bits;
      std::memcpy(&bits, flow.ptr<float>(y) + i, 4);
      toLittleEndian(bits, &row[static_cast<std::size_t>(i) * 4]);
    }
    file.write(reinterpret_cast<const char*>(row.data()), static_cast<std::streamsize>(row.size()));
  }
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path);
}

cv::Mat readFlo(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path);
  std::array<unsigned char, 12> header;
  if (!file.read(reinterpret_cast<char*>(header.data()), header.size()) ||
      std::memcmp(header.data(), kMagic, sizeof kMagic) != 0)
    throw std::runtime_error(path + " is not a .flo file");
  const auto width = static_cast<std::int32_t>(fromLittleEndian(&header[4]));
  const auto height = static_cast<std::int32_t>(fromLittleEndian(&header[8]));
  if (width < 1 || height < 1 || width > kLargestSide || height > kLargestSide)
    throw std::runtime_error(path + ": the size in its header is not plausible");
  // Twelve bytes may not ask for gigabytes.
  const std::streamoff pixels = static_cast<std::streamoff>(width) * height * 8, begin = file.tellg();
  if (!file.seekg(0, std::ios::end) || file.tellg() - begin < pixels || !file.seekg(begin))
    throw std::runtime_error(path + " ends early");
  cv::Mat flow(height, width, CV_32FC2);
  std::vector<unsigned char> row(static_cast<std::size_t>(width) * 8);
  for (int y = 0; y < height; ++y) {
    if (!file.read(reinterpret_cast<char*>(row.data()), static_cast<std::streamsize>(row.size())))
      throw std::runtime_error(path + " ends early");
    for (int i = 0; i < 2 * width; ++i) {
      const std::uint32_t bits = fromLittleEndian(&row[static_cast<std::size_t>(i) * 4]);
      std::memcpy(flow.ptr<float>(y) + i, &bits, 4);
    }
  }
  return flow;
}

}  // namespace cortshift_flow
