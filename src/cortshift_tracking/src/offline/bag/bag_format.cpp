#include "offline/bag/bag_format.hpp"

#include <bzlib.h>
#include <roslz4/lz4s.h>

#include <algorithm>

#include "cortshift_flow/text.hpp"

namespace cortshift_tracking::bag {
namespace {

/// Grows with what comes out: the size that a damaged header says is never taken on trust.
std::string uncompressBz2(const std::string& stored, std::uint32_t size, const Place& place) {
  bz_stream stream{};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) throw FormatError("no memory to uncompress the chunk", place);
  stream.next_in = const_cast<char*>(stored.data());  // taken without being changed
  stream.avail_in = static_cast<unsigned>(stored.size());
  std::string out;
  std::size_t done = 0;
  int state = BZ_OK;
  while (state == BZ_OK && done < size) {
    out.resize(std::min<std::size_t>(size, std::max<std::size_t>(1u << 20, 2 * done)));
    stream.next_out = &out[done];
    stream.avail_out = static_cast<unsigned>(out.size() - done);
    state = BZ2_bzDecompress(&stream);
    const std::size_t now = out.size() - stream.avail_out;
    if (now == done && stream.avail_in == 0) break;  // it is cut
    done = now;
  }
  char more = 0;
  while (state == BZ_OK && stream.avail_in > 0) {  // the end mark, and no byte beyond
    stream.next_out = &more;
    stream.avail_out = 1;
    state = BZ2_bzDecompress(&stream);
    if (stream.avail_out == 0) break;
  }
  BZ2_bzDecompressEnd(&stream);
  if (state != BZ_STREAM_END || done != size) throw FormatError("a bz2 chunk cannot be uncompressed", place);
  return out;
}

std::string uncompressLz4(const std::string& stored, std::uint32_t size, const Place& place) {
  constexpr std::uint64_t kMostExpansion =
      255;  // a byte of LZ4 stands for at most 255: the block format's length codes
  if (size > kMostExpansion * stored.size())
    throw FormatError("an lz4 chunk cannot be as large as its header says", place);
  std::string out(size, '\0');
  unsigned got = size;
  if (roslz4_buffToBuffDecompress(const_cast<char*>(stored.data()), static_cast<unsigned>(stored.size()), &out[0],
                                  &got) != ROSLZ4_OK ||
      got != size)
    throw FormatError("an lz4 chunk cannot be uncompressed", place);
  return out;
}

}  // namespace

std::string Place::text() const {
  const std::string at = "at byte " + std::to_string(byte);
  return chunk ? at + " of what the chunk at byte " + std::to_string(*chunk) + " holds" : at;
}

ros::Time timeAt(const char* bytes, const Place& place) {
  ros::Time time;
  time.sec = numberAt<std::uint32_t>(bytes);
  time.nsec = numberAt<std::uint32_t>(bytes + 4);
  if (time.nsec >= 1000000000u) throw FormatError("a time is none", place);
  return time;
}

Fields::Fields(const char* bytes, std::size_t size, const Place& place) : place_(place) {
  for (std::size_t at = 0; at < size;) {
    if (size - at < 4) throw FormatError("a record's header is cut", place + at);
    const std::uint32_t length = numberAt<std::uint32_t>(bytes + at);
    at += 4;
    if (length > size - at) throw FormatError("a record's header is damaged", place + at);
    const char* equals = static_cast<const char*>(std::memchr(bytes + at, '=', length));
    if (equals == nullptr) throw FormatError("a record's header is damaged", place + at);
    const std::size_t name = static_cast<std::size_t>(equals - (bytes + at));
    values_[std::string(bytes + at, name)] = std::string(equals + 1, length - name - 1);
    at += length;
  }
}

const char* Fields::sized(const char* name, std::size_t size) const {
  const auto found = values_.find(name);
  if (found == values_.end() || found->second.size() != size)
    throw FormatError(std::string("a record lacks its field '") + name + "'", place_);
  return found->second.data();
}

std::string Fields::text(const char* name) const {
  const auto found = values_.find(name);
  return found == values_.end() ? std::string() : found->second;
}

InnerRecord innerRecord(const std::string& content, std::size_t at, std::uint64_t chunk) {
  const Place place{at, chunk};
  if (at > content.size() || content.size() - at < 4) throw FormatError("a chunk is cut", place);
  const std::uint32_t header = numberAt<std::uint32_t>(content.data() + at);
  if (header > kMaxHeader || content.size() - at - 4 < header + 4ull) throw FormatError("a chunk is damaged", place);
  InnerRecord inner;
  inner.fields = Fields(content.data() + at + 4, header, place + 4);
  inner.data_size = numberAt<std::uint32_t>(content.data() + at + 4 + header);
  inner.data = content.data() + at + 8 + header;
  if (content.size() - (at + 8 + header) < inner.data_size) throw FormatError("a chunk is cut", place);
  inner.next = at + 8 + header + inner.data_size;
  return inner;
}

std::string uncompress(const std::string& stored, const std::string& compression, std::uint32_t size,
                       const Place& place) try {
  if (compression == "none") return stored;
  if (compression == "bz2") return uncompressBz2(stored, size, place);
  if (compression == "lz4") return uncompressLz4(stored, size, place);
  throw FormatError("a chunk is compressed as '" + compression + "' (none, bz2 and lz4 are known)", place);
} catch (const std::bad_alloc&) {
  throw FormatError("no memory to uncompress the chunk of " + megabytes(size), place);
}

std::string megabytes(std::uint64_t bytes) {
  return cortshift_flow::formatted("%.1f MB", 1e-6 * static_cast<double>(bytes));
}

}  // namespace cortshift_tracking::bag
