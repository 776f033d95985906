#include "cortshift_tracking/case/durable_file.hpp"

#include <boost/crc.hpp>

namespace cortshift_tracking {
namespace {

/// What the disk refuses is a refusal of the case.
template <typename Call>
auto refusing(const Call& call) {
  try {
    return call();
  } catch (const cortshift_stereo::UnreadableError& error) {
    throw UnreadableFile(error.what());
  } catch (const cortshift_stereo::FileError& error) {
    throw TrackingError(error.what());
  }
}

}  // namespace

void replaceDurably(const std::filesystem::path& path, const void* bytes, std::size_t size) {
  refusing([&] { cortshift_stereo::replaceDurably(path, bytes, size); });
}

void writeDurably(const std::filesystem::path& path, const void* bytes, std::size_t size) {
  refusing([&] { cortshift_stereo::writeDurably(path, bytes, size); });
}

void appendDurably(const std::filesystem::path& path, const void* bytes, std::size_t size) {
  refusing([&] { cortshift_stereo::appendDurably(path, bytes, size); });
}

void moveDurably(const std::filesystem::path& from, const std::filesystem::path& to) {
  refusing([&] { cortshift_stereo::moveDurably(from, to); });
}

std::filesystem::path moveAside(const std::filesystem::path& folder, const std::filesystem::path& path,
                                const std::string& aside) {
  namespace fs = std::filesystem;
  const std::string name = path.filename().string();
  fs::path to = folder / aside / name;
  try {
    fs::create_directories(folder / aside);
    for (int i = 1; fs::exists(fs::symlink_status(to)); ++i) to = folder / aside / (name + "." + std::to_string(i));
  } catch (const fs::filesystem_error& error) {
    throw TrackingError(path.string() + " cannot be moved to " + aside + ": " + error.what());
  }
  moveDurably(path, to);
  return to;
}

std::string readWhole(const std::filesystem::path& path) {
  return refusing([&] { return cortshift_stereo::readWhole(path); });
}

std::uint32_t crc32(const void* bytes, std::size_t size) {
  boost::crc_32_type crc;
  crc.process_bytes(bytes, size);
  return crc.checksum();
}

}  // namespace cortshift_tracking
