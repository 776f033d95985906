#include "offline/bag/bag_index.hpp"

#include <algorithm>

namespace cortshift_tracking::bag {
namespace {

const std::string kMagic = "#ROSBAG V2.0\n";

void requireMagic(const BagRecords& records, const std::string& unusable) {
  const std::string magic = records.bytes(0, std::min<std::uint64_t>(kMagic.size(), records.size()));
  if (magic == kMagic) return;
  if (magic.compare(0, 8, "#ROSBAG ") == 0)
    throw TrackingError(unusable + "it has the old format" + magic.substr(7, magic.find('\n') - 7) +
                        "; convert it with `rosbag reindex` and `rosbag filter`");
  throw TrackingError(unusable + "it does not begin as a bag does; give a .bag file of ROS 1");
}

}  // namespace

BagIndex::BagIndex(const BagRecords& records, const std::string& path, const std::vector<std::string>& wanted)
    : records_(records), wanted_(wanted) {
  const std::string unusable = path + " is not a usable ROS bag: ";
  requireMagic(records, unusable);
  Record head;
  try {
    head = records.record(kMagic.size());
    if (head.fields.op() != kBagHeader) throw FormatError("its header is damaged", head.fields.place());
  } catch (const FormatError& error) {
    throw TrackingError(unusable + error.what() + "; " + kDamagedBagRemedy);
  }
  if (!head.fields.text("encryptor").empty())
    throw TrackingError(unusable + "it is encrypted; decrypt it with `rosbag decrypt` first");
  bool indexed = false;
  try {
    const std::uint64_t position = head.fields.number<std::uint64_t>("index_pos");
    if (position == 0) {
      remarks.push_back("it has no index: the recording was not closed");
    } else if (position > records.size()) {
      remarks.push_back("it is cut: " + megabytes(position - records.size()) + " and more are missing at its end");
    } else {
      read(position, head.fields.number<std::uint32_t>("conn_count"), head.fields.number<std::uint32_t>("chunk_count"));
      indexed = true;
    }
  } catch (const FormatError& error) {
    remarks.push_back(std::string("its index is damaged (") + error.what() + ")");
  }
  if (!indexed) walk(head.next());
}

const Connection& BagIndex::connection(std::uint32_t id, const Place& place) const {
  const auto found = connections_.find(id);
  if (found == connections_.end()) throw FormatError("a message's connection is missing", place);
  return found->second;
}

void BagIndex::add(const Fields& head, const char* data, std::size_t size, const Place& place) {
  const std::uint32_t id = head.number<std::uint32_t>("conn");
  if (connections_.count(id) != 0) return;
  const Fields fields(data, size, place);
  const BagTopic topic{head.text("topic"), fields.text("type"), fields.text("md5sum"), fields.text("latching") == "1",
                       0};
  const auto same = std::find_if(topics.begin(), topics.end(), [&](const BagTopic& other) {
    return other.name == topic.name && other.type == topic.type && other.md5sum == topic.md5sum;
  });
  Connection connection;
  connection.topic = static_cast<std::size_t>(same - topics.begin());
  if (same == topics.end()) topics.push_back(topic);
  const auto wanted = std::find(wanted_.begin(), wanted_.end(), topic.name);
  if (wanted != wanted_.end()) connection.bit = static_cast<unsigned>(wanted - wanted_.begin());
  connections_[id] = connection;
}

void BagIndex::read(std::uint64_t position, std::uint32_t connections, std::uint32_t chunk_count) {
  // Nothing is reserved for counts that a damaged header may say: each entry has to be there.
  for (std::uint32_t i = 0; i < connections; ++i) {
    const Record head = records_.record(position);
    if (head.fields.op() != kConnection || head.data_size > kMaxHeader)
      throw FormatError("a connection is missing", head.fields.place());
    const std::string data = records_.bytes(head.data, head.data_size);
    add(head.fields, data.data(), data.size(), {head.data, {}});
    position = head.next();
  }
  std::vector<std::uint64_t> counts(topics.size());
  for (std::uint32_t i = 0; i < chunk_count; ++i) {
    const Record head = records_.record(position);
    if (head.fields.op() != kChunkInfo) throw FormatError("a chunk's entry is missing", head.fields.place());
    if (head.data_size > 0) {
      chunks.push_back(chunkOf(head, counts));
      begin = std::min(begin, chunks.back().begin);
      end = std::max(end, chunks.back().end);
    }
    position = head.next();
  }
  // What the counts leave out would silently be missing.
  if (position != records_.size()) throw FormatError("more than it counts follows", {position, {}});
  for (std::size_t i = 0; i < counts.size(); ++i) topics[i].messages = counts[i];
  requireChunks();
}

Chunk BagIndex::chunkOf(const Record& head, std::vector<std::uint64_t>& counts) const {
  const Place place = head.fields.place();
  Chunk chunk{head.fields.number<std::uint64_t>("chunk_pos"), head.fields.time("start_time"),
              head.fields.time("end_time"), 0};
  if (chunk.begin > chunk.end) throw FormatError("a chunk ends before it begins", place);
  if (head.data_size != 8ull * head.fields.number<std::uint32_t>("count"))
    throw FormatError("a chunk's entry is not as long as it says", place);
  const std::string content = records_.bytes(head.data, head.data_size);
  for (std::size_t at = 0; at < content.size(); at += 8) {
    const Connection& found = connection(numberAt<std::uint32_t>(content.data() + at), place);
    counts[found.topic] += numberAt<std::uint32_t>(content.data() + at + 4);
    if (found.bit) chunk.mask |= std::uint64_t{1} << *found.bit;
  }
  return chunk;
}

void BagIndex::requireChunks() {
  std::uint64_t free = 0;
  std::vector<std::uint64_t> positions;
  for (const Chunk& chunk : chunks) positions.push_back(chunk.position);
  std::sort(positions.begin(), positions.end());
  for (const std::uint64_t position : positions) {
    const ChunkHead head = records_.chunkHead(position);
    if (position < free) throw FormatError("two chunks overlap", {position, {}});
    free = head.next();
    ++compressions[head.compression];
  }
}

void BagIndex::walk(std::uint64_t position) {
  connections_.clear();
  topics.clear();
  chunks.clear();
  compressions.clear();
  begin = ros::TIME_MAX;
  end = ros::Time();
  try {
    while (position < records_.size()) {
      const Record record = records_.record(position);
      const std::uint8_t op = record.fields.op();
      if (op == kConnection || op == kChunkInfo) break;  // the index at the end
      if (op != kChunk) throw FormatError("a record is out of place", {position, {}});
      const ChunkHead head = records_.chunkHead(position);
      if (head.stored == 0) throw FormatError("its last chunk was not finished", {position, {}});
      const Chunk chunk = scan(position, head);
      if (chunk.begin <= chunk.end) {
        chunks.push_back(chunk);
        begin = std::min(begin, chunk.begin);
        end = std::max(end, chunk.end);
      }
      ++compressions[head.compression];
      position = head.next();
      while (position < records_.size()) {
        const Record next = records_.record(position);
        if (next.fields.op() != kIndex) break;
        position = next.next();
      }
    }
  } catch (const FormatError& error) {
    remarks.push_back(std::string(error.what()) + ": the last " +
                      megabytes(records_.size() - std::min(records_.size(), position)) + " are left out");
  }
}

Chunk BagIndex::scan(std::uint64_t position, const ChunkHead& head) {
  Chunk chunk{position, ros::TIME_MAX, ros::Time(), 0};
  std::map<std::size_t, std::uint64_t> counts;  // of a chunk that turns out to be damaged nothing counts
  const auto count = [&](const Connection& connection, const ros::Time& time) {
    ++counts[connection.topic];
    if (connection.bit) chunk.mask |= std::uint64_t{1} << *connection.bit;
    chunk.begin = std::min(chunk.begin, time);
    chunk.end = std::max(chunk.end, time);
  };
  // With the index records that follow the chunk only their times are read; without them the chunk itself.
  const std::vector<ChunkIndex> indexes = records_.indexesAfter(head);
  const bool known = std::all_of(indexes.begin(), indexes.end(),
                                 [&](const ChunkIndex& index) { return connections_.count(index.connection) != 0; });
  if (known && !indexes.empty()) {
    for (const ChunkIndex& index : indexes)
      for (const ChunkIndex::Message& message : records_.messagesOf(index))
        count(connections_.at(index.connection), message.time);
  } else {
    const std::string& content = records_.content(position, head);
    for (std::size_t at = 0; at < content.size();) {
      const InnerRecord inner = innerRecord(content, at, position);
      const std::uint8_t op = inner.fields.op();
      if (op == kConnection)
        add(inner.fields, inner.data, inner.data_size, inner.fields.place());
      else if (op == kMessage)
        count(connection(inner.fields.number<std::uint32_t>("conn"), inner.fields.place()), inner.fields.time("time"));
      at = inner.next;
    }
  }
  for (const auto& [topic, messages] : counts) topics[topic].messages += messages;
  return chunk;
}

}  // namespace cortshift_tracking::bag
