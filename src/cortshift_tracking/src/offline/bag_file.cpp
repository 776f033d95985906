#include "cortshift_tracking/offline/bag_file.hpp"

#include <bzlib.h>
#include <fcntl.h>
#include <roslz4/lz4s.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace cortshift_tracking {
namespace {

constexpr const char* kMagic = "#ROSBAG V2.0\n";
constexpr std::size_t kMagicSize = 13;
constexpr std::uint32_t kMaxHeader = 1u << 20, kMaxChunk = 1u << 30;
constexpr std::size_t kCachedChunks = 2;

enum Op : std::uint8_t { kMessage = 2, kBagHeader = 3, kIndex = 4, kChunk = 5, kChunkInfo = 6, kConnection = 7 };

/// A record that does not keep the format; where it is met decides what that means.
class FormatError : public TrackingError {
 public:
  using TrackingError::TrackingError;
};

template <typename T>
T number(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

template <typename T>
T field(const std::map<std::string, std::string>& fields, const char* name) {
  const auto found = fields.find(name);
  if (found == fields.end() || found->second.size() != sizeof(T))
    throw FormatError(std::string("a record lacks its field '") + name + "'");
  return number<T>(found->second.data());
}

std::string text(const std::map<std::string, std::string>& fields, const char* name) {
  const auto found = fields.find(name);
  return found == fields.end() ? std::string() : found->second;
}

ros::Time timeAt(const char* bytes) {
  ros::Time time;
  time.sec = number<std::uint32_t>(bytes);
  time.nsec = number<std::uint32_t>(bytes + 4);
  return time;
}

ros::Time timeField(const std::map<std::string, std::string>& fields, const char* name) {
  const auto found = fields.find(name);
  if (found == fields.end() || found->second.size() != 8)
    throw FormatError(std::string("a record lacks its field '") + name + "'");
  return timeAt(found->second.data());
}

std::map<std::string, std::string> parseFields(const char* bytes, std::size_t size) {
  std::map<std::string, std::string> fields;
  for (std::size_t at = 0; at < size;) {
    if (size - at < 4) throw FormatError("a record's header is cut");
    const std::uint32_t length = number<std::uint32_t>(bytes + at);
    at += 4;
    if (length > size - at) throw FormatError("a record's header is damaged");
    const char* equals = static_cast<const char*>(std::memchr(bytes + at, '=', length));
    if (equals == nullptr) throw FormatError("a record's header is damaged");
    const std::size_t name = static_cast<std::size_t>(equals - (bytes + at));
    fields[std::string(bytes + at, name)] = std::string(equals + 1, length - name - 1);
    at += length;
  }
  return fields;
}

std::uint8_t opOf(const std::map<std::string, std::string>& fields) { return field<std::uint8_t>(fields, "op"); }

/// A record within an uncompressed chunk.
struct Inner {
  std::map<std::string, std::string> fields;
  const char* data = nullptr;
  std::uint32_t data_size = 0;
  std::size_t next = 0;
};

Inner innerRecord(const std::string& chunk, std::size_t at) {
  if (chunk.size() < at + 4) throw FormatError("a chunk is cut");
  const std::uint32_t header = number<std::uint32_t>(chunk.data() + at);
  if (header > kMaxHeader || chunk.size() - at - 4 < header + 4ull) throw FormatError("a chunk is damaged");
  Inner inner;
  inner.fields = parseFields(chunk.data() + at + 4, header);
  inner.data_size = number<std::uint32_t>(chunk.data() + at + 4 + header);
  inner.data = chunk.data() + at + 8 + header;
  if (chunk.size() - (at + 8 + header) < inner.data_size) throw FormatError("a chunk is cut");
  inner.next = at + 8 + header + inner.data_size;
  return inner;
}

std::string uncompress(const std::string& stored, const std::string& compression, std::uint32_t size) {
  if (compression == "none") return stored;
  std::string out(size, '\0');
  unsigned got = size;
  char* in = const_cast<char*>(stored.data());  // both libraries take it without changing it
  if (compression == "bz2") {
    if (BZ2_bzBuffToBuffDecompress(&out[0], &got, in, static_cast<unsigned>(stored.size()), 0, 0) != BZ_OK)
      throw FormatError("a bz2 chunk cannot be uncompressed");
  } else if (compression == "lz4") {
    if (roslz4_buffToBuffDecompress(in, static_cast<unsigned>(stored.size()), &out[0], &got) != ROSLZ4_OK)
      throw FormatError("an lz4 chunk cannot be uncompressed");
  } else {
    throw FormatError("a chunk is compressed as '" + compression + "'; none, bz2 and lz4 are known");
  }
  if (got != size) throw FormatError("a chunk has not the size that its header says");
  return out;
}

std::string megabytes(std::uint64_t bytes) {
  char out[40];
  std::snprintf(out, sizeof out, "%.1f MB", 1e-6 * static_cast<double>(bytes));
  return out;
}

}  // namespace

BagFile::BagFile(const std::filesystem::path& path, const std::vector<std::string>& wanted)
    : path_(path), wanted_(wanted), begin_(ros::TIME_MAX) {
  if (wanted.size() > 64) throw std::invalid_argument("BagFile: at most 64 topics");
  file_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat state {};
  if (file_ < 0 || ::fstat(file_, &state) != 0 || !S_ISREG(state.st_mode)) {
    const std::string reason = file_ < 0 ? std::strerror(errno) : "it is not a file";
    if (file_ >= 0) ::close(file_);
    throw TrackingError(path.string() + " cannot be read: " + reason);
  }
  size_ = static_cast<std::uint64_t>(state.st_size);
  ::posix_fadvise(file_, 0, 0, POSIX_FADV_RANDOM);  // no reading ahead into images that nobody asks for
  try {
    readHeader();
  } catch (...) {
    ::close(file_);
    throw;
  }
}

BagFile::~BagFile() { ::close(file_); }

std::string BagFile::bytes(std::uint64_t position, std::uint64_t count) const {
  if (position > size_ || count > size_ - position) throw FormatError("the file ends too early");
  std::string out(count, '\0');
  for (std::uint64_t done = 0; done < count;) {
    const ssize_t got = ::pread(file_, &out[done], count - done, static_cast<off_t>(position + done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) throw TrackingError(path_.string() + " cannot be read: " + (got < 0 ? std::strerror(errno) : "cut"));
    done += static_cast<std::uint64_t>(got);
  }
  return out;
}

BagFile::Record BagFile::record(std::uint64_t position) const {
  constexpr std::uint64_t kUsual = 160;  // most headers at one go
  if (position + 4 > size_) throw FormatError("the file ends too early");
  std::string head = bytes(position, std::min(kUsual, size_ - position));
  const std::uint32_t length = number<std::uint32_t>(head.data());
  if (length > kMaxHeader) throw FormatError("a record's header is damaged");
  if (head.size() < length + 8ull) head = bytes(position, length + 8ull);
  Record out;
  out.fields = parseFields(head.data() + 4, length);
  out.data_size = number<std::uint32_t>(head.data() + 4 + length);
  out.data = position + 8 + length;
  return out;
}

BagFile::ChunkHead BagFile::chunkHead(std::uint64_t position) const {
  const Record head = record(position);
  if (opOf(head.fields) != kChunk) throw FormatError("there is no chunk where the index says so");
  ChunkHead chunk{head.data, head.data_size, field<std::uint32_t>(head.fields, "size"),
                  text(head.fields, "compression")};
  if (chunk.size > kMaxChunk || chunk.stored > kMaxChunk)
    throw FormatError("a chunk of " + megabytes(std::max(chunk.size, chunk.stored)) +
                      " is too large; record with a smaller chunk size");
  return chunk;
}

void BagFile::readHeader() {
  const std::string remedy = path_.string() + " is not a usable ROS bag: ";
  const std::string magic = bytes(0, std::min<std::uint64_t>(kMagicSize, size_));
  if (magic != kMagic) {
    if (magic.compare(0, 8, "#ROSBAG ") == 0)
      throw TrackingError(remedy + "it has the old format" + magic.substr(7, magic.find('\n') - 7) +
                          "; convert it with `rosbag reindex` and `rosbag filter`");
    throw TrackingError(remedy + "it does not begin as a bag does; give a .bag file of ROS 1");
  }
  Record head;
  try {
    head = record(kMagicSize);
    if (opOf(head.fields) != kBagHeader) throw FormatError("its header is damaged");
  } catch (const FormatError& error) {
    throw TrackingError(remedy + error.what() + "; get another copy of the recording");
  }
  if (!text(head.fields, "encryptor").empty())
    throw TrackingError(remedy + "it is encrypted; decrypt it with `rosbag decrypt` first");
  first_record_ = head.next();
  bool indexed = false;
  try {
    indexed = readIndex(field<std::uint64_t>(head.fields, "index_pos"), field<std::uint32_t>(head.fields, "conn_count"),
                        field<std::uint32_t>(head.fields, "chunk_count"));
  } catch (const FormatError& error) {
    remarks_.push_back(std::string("its index is damaged (") + error.what() + ")");
  }
  if (!indexed) walk();
}

void BagFile::addConnection(const Record& head, const std::string& data) {
  const std::uint32_t id = field<std::uint32_t>(head.fields, "conn");
  if (connections_.count(id) != 0) return;
  const auto fields = parseFields(data.data(), data.size());
  const BagTopic topic{text(head.fields, "topic"), text(fields, "type"), text(fields, "md5sum"),
                       text(fields, "latching") == "1", 0};
  Connection connection;
  const auto same = std::find_if(topics_.begin(), topics_.end(), [&](const BagTopic& other) {
    return other.name == topic.name && other.type == topic.type && other.md5sum == topic.md5sum;
  });
  connection.topic = static_cast<std::size_t>(same - topics_.begin());
  if (same == topics_.end()) topics_.push_back(topic);
  const auto wanted = std::find(wanted_.begin(), wanted_.end(), topic.name);
  if (wanted != wanted_.end()) connection.bit = static_cast<unsigned>(wanted - wanted_.begin());
  connections_[id] = connection;
}

bool BagFile::readIndex(std::uint64_t position, std::uint32_t connections, std::uint32_t chunks) {
  if (position == 0) {
    remarks_.push_back("it has no index: the recording was not closed");
    return false;
  }
  if (position > size_) {
    remarks_.push_back("it is cut: " + megabytes(position - size_) + " and more are missing at its end");
    return false;
  }
  for (std::uint32_t i = 0; i < connections; ++i) {
    const Record head = record(position);
    if (opOf(head.fields) != kConnection) throw FormatError("a connection is missing");
    addConnection(head, bytes(head.data, head.data_size));
    position = head.next();
  }
  chunks_.reserve(chunks);
  std::vector<std::uint64_t> counts(topics_.size());
  for (std::uint32_t i = 0; i < chunks; ++i) {
    const Record head = record(position);
    if (opOf(head.fields) != kChunkInfo) throw FormatError("a chunk's entry is missing");
    Chunk chunk{field<std::uint64_t>(head.fields, "chunk_pos"), timeField(head.fields, "start_time"),
                timeField(head.fields, "end_time"), 0};
    const std::string content = bytes(head.data, head.data_size);
    for (std::size_t at = 0; at + 8 <= content.size(); at += 8) {
      const auto found = connections_.find(number<std::uint32_t>(content.data() + at));
      if (found == connections_.end()) throw FormatError("a connection is missing");
      counts[found->second.topic] += number<std::uint32_t>(content.data() + at + 4);
      if (found->second.bit) chunk.mask |= std::uint64_t{1} << *found->second.bit;
    }
    if (!content.empty()) {
      begin_ = std::min(begin_, chunk.begin);
      end_ = std::max(end_, chunk.end);
      chunks_.push_back(chunk);
    }
    position = head.next();
  }
  for (std::size_t i = 0; i < counts.size(); ++i) topics_[i].messages = counts[i];
  for (const Chunk& chunk : chunks_) ++compressions_[chunkHead(chunk.position).compression];
  return true;
}

void BagFile::walk() {
  connections_.clear();
  topics_.clear();
  chunks_.clear();
  compressions_.clear();
  begin_ = ros::TIME_MAX;
  end_ = ros::Time();
  std::uint64_t position = first_record_;
  try {
    while (position < size_) {
      const Record head = record(position);
      const std::uint8_t op = opOf(head.fields);
      if (op == kConnection || op == kChunkInfo) break;  // the index at the end
      if (op != kChunk) throw FormatError("a record is out of place");
      const ChunkHead chunk_head = chunkHead(position);
      if (chunk_head.stored == 0 || head.next() > size_) throw FormatError("its last chunk was not finished");
      Chunk chunk{position, ros::TIME_MAX, ros::Time(), 0};
      scanChunk(chunk_head, chunk);
      if (chunk.begin <= chunk.end) {
        chunks_.push_back(chunk);
        begin_ = std::min(begin_, chunk.begin);
        end_ = std::max(end_, chunk.end);
      }
      ++compressions_[chunk_head.compression];
      position = head.next();
      while (position < size_) {
        const Record next = record(position);
        if (opOf(next.fields) != kIndex) break;
        position = next.next();
      }
    }
  } catch (const FormatError& error) {
    remarks_.push_back(std::string(error.what()) + ": the last " + megabytes(size_ - std::min(size_, position)) +
                       " are left out");
  }
}

std::vector<BagFile::ChunkIndex> BagFile::indexRecords(const ChunkHead& head) const {
  std::vector<ChunkIndex> out;
  try {
    for (std::uint64_t position = head.data + head.stored; position < size_;) {
      const Record next = record(position);
      if (opOf(next.fields) != kIndex) break;
      if (next.next() > size_) throw FormatError("the file ends too early");
      out.push_back({field<std::uint32_t>(next.fields, "conn"), next.data, next.data_size});
      position = next.next();
    }
  } catch (const FormatError&) {
    out.clear();  // cut within: the chunk itself is whole
  }
  return out;
}

void BagFile::scanChunk(const ChunkHead& head, Chunk& chunk) {
  // With the index records that follow the chunk only their times are read; without them the chunk itself.
  const std::vector<ChunkIndex> indexes = indexRecords(head);
  const auto count = [&](std::uint32_t id, const ros::Time& time) {
    const Connection& connection = connections_.at(id);
    ++topics_[connection.topic].messages;
    if (connection.bit) chunk.mask |= std::uint64_t{1} << *connection.bit;
    chunk.begin = std::min(chunk.begin, time);
    chunk.end = std::max(chunk.end, time);
  };
  const bool known = std::all_of(indexes.begin(), indexes.end(),
                                 [&](const ChunkIndex& index) { return connections_.count(index.connection) != 0; });
  if (known && !indexes.empty()) {
    for (const ChunkIndex& index : indexes) {
      const std::string content = bytes(index.data, index.data_size);
      for (std::size_t at = 0; at + 12 <= content.size(); at += 12)
        count(index.connection, timeAt(content.data() + at));
    }
    return;
  }
  const std::string content = uncompress(bytes(head.data, head.stored), head.compression, head.size);
  for (std::size_t at = 0; at < content.size();) {
    const Inner inner = innerRecord(content, at);
    const std::uint8_t op = opOf(inner.fields);
    if (op == kConnection) {
      Record connection;
      connection.fields = inner.fields;
      addConnection(connection, std::string(inner.data, inner.data_size));
    } else if (op == kMessage) {
      const std::uint32_t id = field<std::uint32_t>(inner.fields, "conn");
      if (connections_.count(id) == 0) throw FormatError("a message without its connection");
      count(id, timeField(inner.fields, "time"));
    }
    at = inner.next;
  }
}

ros::Time BagFile::begin() const {
  if (chunks_.empty()) throw TrackingError(path_.string() + " holds no message; record again");
  return begin_;
}

ros::Time BagFile::end() const {
  begin();  // says if there is none
  return end_;
}

std::uint64_t BagFile::messages(const std::string& name) const {
  std::uint64_t count = 0;
  for (const BagTopic& topic : topics_)
    if (topic.name == name) count += topic.messages;
  return count;
}

std::uint64_t BagFile::maskOf(const std::vector<std::string>& names) const {
  std::uint64_t mask = 0;
  for (const std::string& name : names) {
    const auto found = std::find(wanted_.begin(), wanted_.end(), name);
    if (found == wanted_.end()) throw std::invalid_argument("BagFile: " + name + " is not one of the wanted topics");
    mask |= std::uint64_t{1} << (found - wanted_.begin());
  }
  return mask;
}

void BagFile::indexOfChunk(const Chunk& chunk, std::uint64_t mask, const ros::Time& from, const ros::Time& to,
                           std::vector<BagEntry>& out) const try {
  const std::uint64_t position = chunk.position;
  const ChunkHead head = chunkHead(position);
  const auto add = [&](const Connection& connection, const ros::Time& time, std::uint32_t offset) {
    if (connection.bit && (mask >> *connection.bit & 1) != 0 && time >= from && time <= to)
      out.push_back({time, position, offset, static_cast<std::uint32_t>(connection.topic)});
  };
  const std::vector<ChunkIndex> indexes = indexRecords(head);
  for (const ChunkIndex& index : indexes) {
    const Connection& connection = connections_.at(index.connection);
    if (!connection.bit || (mask >> *connection.bit & 1) == 0) continue;
    const std::string content = bytes(index.data, index.data_size);
    for (std::size_t i = 0; i + 12 <= content.size(); i += 12)
      add(connection, timeAt(content.data() + i), number<std::uint32_t>(content.data() + i + 8));
  }
  if (!indexes.empty()) return;
  const std::string& content = uncompressed(position);  // the last chunk of a recording that broke off
  for (std::size_t at = 0; at < content.size();) {
    const Inner inner = innerRecord(content, at);
    if (opOf(inner.fields) == kMessage)
      add(connections_.at(field<std::uint32_t>(inner.fields, "conn")), timeField(inner.fields, "time"),
          static_cast<std::uint32_t>(at));
    at = inner.next;
  }
} catch (const FormatError& error) {
  throw TrackingError(path_.string() + ": the chunk at " + std::to_string((chunk.begin - begin_).toSec()) +
                      " s is damaged (" + error.what() + "); get another copy of the recording");
}

std::vector<BagEntry> BagFile::entries(const std::vector<std::string>& names, const ros::Time& from,
                                       const ros::Time& to) const {
  const std::uint64_t mask = maskOf(names);
  std::vector<BagEntry> out;
  for (const Chunk& chunk : chunks_)
    if ((chunk.mask & mask) != 0 && chunk.begin <= to && chunk.end >= from) indexOfChunk(chunk, mask, from, to, out);
  std::sort(out.begin(), out.end());
  return out;
}

std::vector<BagEntry> BagFile::lastBefore(const std::string& name, const ros::Time& time, std::size_t count) const {
  const std::uint64_t mask = maskOf({name});
  std::vector<const Chunk*> candidates;
  for (const Chunk& chunk : chunks_)
    if ((chunk.mask & mask) != 0 && chunk.begin <= time) candidates.push_back(&chunk);
  std::sort(candidates.begin(), candidates.end(), [](const Chunk* a, const Chunk* b) { return a->end > b->end; });
  std::vector<BagEntry> found;
  for (const Chunk* chunk : candidates) {
    if (found.size() == count && chunk->end < found.back().time) break;
    indexOfChunk(*chunk, mask, ros::Time(), time, found);
    std::sort(found.rbegin(), found.rend());
    if (found.size() > count) found.resize(count);
  }
  return found;
}

const std::string& BagFile::uncompressed(std::uint64_t chunk) const {
  for (auto it = cache_.begin(); it != cache_.end(); ++it)
    if (it->first == chunk) {
      cache_.splice(cache_.begin(), cache_, it);
      return cache_.front().second;
    }
  while (cache_.size() >= kCachedChunks) cache_.pop_back();  // before the next one takes its memory
  const ChunkHead head = chunkHead(chunk);
  cache_.emplace_front(chunk, uncompress(bytes(head.data, head.stored), head.compression, head.size));
  return cache_.front().second;
}

std::string BagFile::message(const BagEntry& entry, std::uint32_t at_most) const {
  try {
    const ChunkHead head = chunkHead(entry.chunk);
    if (head.compression == "none") {
      const Record found = record(head.data + entry.offset);
      if (opOf(found.fields) != kMessage) throw FormatError("there is no message where the index says so");
      return bytes(found.data, std::min(found.data_size, at_most));
    }
    const Inner inner = innerRecord(uncompressed(entry.chunk), entry.offset);
    if (opOf(inner.fields) != kMessage) throw FormatError("there is no message where the index says so");
    return std::string(inner.data, std::min(inner.data_size, at_most));
  } catch (const FormatError& error) {
    refuse(entry, error.what());
  }
}

ros::Time BagFile::stampOf(const BagEntry& entry) const {
  const std::string head = message(entry, 12);  // std_msgs/Header: seq, stamp, frame
  if (head.size() < 12) refuse(entry, "it has no header");
  return timeAt(head.data() + 4);
}

void BagFile::requireType(const BagEntry& entry, const std::string& type, const std::string& md5sum) const {
  const BagTopic& topic = topics_[entry.topic];
  if (topic.type == type && topic.md5sum == md5sum) return;
  throw TrackingError(path_.string() + ": " + topic.name + " carries " + topic.type +
                      (topic.type == type ? " of another version" : "") + ", " + type +
                      " is needed; convert the bag with `rosbag fix`, or record that topic");
}

void BagFile::refuse(const BagEntry& entry, const std::string& reason) const {
  throw TrackingError(path_.string() + ": a message on " + topicOf(entry) + " at " +
                      std::to_string((entry.time - begin_).toSec()) + " s is damaged (" + reason +
                      "); get another copy of the recording");
}

}  // namespace cortshift_tracking
