#include "offline/bag/bag_records.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace cortshift_tracking::bag {
namespace {

constexpr std::size_t kCachedChunks = 2;
constexpr std::uint32_t kIndexEntry = 12;  // [bytes] time and offset

}  // namespace

BagRecords::BagRecords(const std::filesystem::path& path) : path_(path) {
  file_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat state {};
  if (file_ < 0 || ::fstat(file_, &state) != 0 || !S_ISREG(state.st_mode)) {
    const std::string reason = file_ < 0 ? std::strerror(errno) : "it is not a file";
    if (file_ >= 0) ::close(file_);
    throw TrackingError(path.string() + " cannot be read: " + reason);
  }
  size_ = static_cast<std::uint64_t>(state.st_size);
  ::posix_fadvise(file_, 0, 0, POSIX_FADV_RANDOM);  // no reading ahead into images that nobody asks for
}

BagRecords::~BagRecords() { ::close(file_); }

std::string BagRecords::bytes(std::uint64_t position, std::uint64_t count) const {
  if (position > size_ || count > size_ - position)
    throw FormatError("the file ends too early for what is said", {position, {}});
  if (count > kMaxChunk) throw FormatError("a record of " + megabytes(count) + " is too large", {position, {}});
  std::string out;
  try {
    out.resize(count);
  } catch (const std::bad_alloc&) {
    throw FormatError("no memory for the record of " + megabytes(count), {position, {}});
  }
  for (std::uint64_t done = 0; done < count;) {
    const ssize_t got = ::pread(file_, &out[done], count - done, static_cast<off_t>(position + done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0)
      throw TrackingError(path_.string() + " cannot be read at byte " + std::to_string(position + done) + ": " +
                          (got < 0 ? std::strerror(errno) : "it became shorter meanwhile") +
                          "; copy the recording again");
    done += static_cast<std::uint64_t>(got);
  }
  return out;
}

Record BagRecords::record(std::uint64_t position) const {
  constexpr std::uint64_t kUsual = 160;  // most headers at one go
  const Place place{position, {}};
  if (position > size_ || size_ - position < 8) throw FormatError("the file ends too early for a record", place);
  std::string head = bytes(position, std::min(kUsual, size_ - position));
  const std::uint32_t length = numberAt<std::uint32_t>(head.data());
  if (length > kMaxHeader) throw FormatError("a record's header is damaged", place);
  if (head.size() < length + 8ull) head = bytes(position, length + 8ull);
  Record out;
  out.fields = Fields(head.data() + 4, length, place + 4);
  out.data_size = numberAt<std::uint32_t>(head.data() + 4 + length);
  out.data = position + 8 + length;
  return out;
}

ChunkHead BagRecords::chunkHead(std::uint64_t position) const {
  const Place place{position, {}};
  const Record head = record(position);
  if (head.fields.op() != kChunk) throw FormatError("there is no chunk where the index says so,", place);
  ChunkHead chunk{head.data, head.data_size, head.fields.number<std::uint32_t>("size"),
                  head.fields.text("compression")};
  if (chunk.size > kMaxChunk || chunk.stored > kMaxChunk)
    throw FormatError("a chunk of " + megabytes(std::max(chunk.size, chunk.stored)) +
                          " (record with a smaller chunk size) is too large",
                      place);
  if (chunk.next() > size_) throw FormatError("a chunk was not finished", place);
  if (chunk.compression == "none" && chunk.size != chunk.stored) throw FormatError("a chunk has two sizes", place);
  return chunk;
}

std::vector<ChunkIndex> BagRecords::indexesAfter(const ChunkHead& head) const {
  std::vector<ChunkIndex> out;
  for (std::uint64_t position = head.next(); position < size_;) {
    Record next;
    try {
      next = record(position);
      if (next.fields.op() != kIndex) break;
      if (next.next() > size_) return {};
    } catch (const FormatError&) {
      return {};  // cut within: the chunk itself is whole
    }
    const ChunkIndex index{next.fields.number<std::uint32_t>("conn"), next.data,
                           next.fields.number<std::uint32_t>("count")};
    if (next.data_size != std::uint64_t{kIndexEntry} * index.count)
      throw FormatError("a chunk's index is not as long as it says,", {position, {}});
    out.push_back(index);
    position = next.next();
  }
  return out;
}

std::vector<ChunkIndex::Message> BagRecords::messagesOf(const ChunkIndex& index) const {
  const std::string content = bytes(index.data, std::uint64_t{kIndexEntry} * index.count);
  std::vector<ChunkIndex::Message> out;
  out.reserve(index.count);
  for (std::size_t at = 0; at < content.size(); at += kIndexEntry)
    out.push_back(
        {timeAt(content.data() + at, {index.data + at, {}}), numberAt<std::uint32_t>(content.data() + at + 8)});
  return out;
}

const std::string& BagRecords::content(std::uint64_t chunk, const ChunkHead& head) const {
  for (auto it = cache_.begin(); it != cache_.end(); ++it)
    if (it->first == chunk) {
      cache_.splice(cache_.begin(), cache_, it);
      return cache_.front().second;
    }
  while (cache_.size() >= kCachedChunks) cache_.pop_back();  // before the next one takes its memory
  cache_.emplace_front(chunk, uncompress(bytes(head.data, head.stored), head.compression, head.size, {chunk, {}}));
  return cache_.front().second;
}

}  // namespace cortshift_tracking::bag
