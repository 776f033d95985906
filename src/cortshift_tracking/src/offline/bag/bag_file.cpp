#include "cortshift_tracking/offline/bag/bag_file.hpp"

#include <algorithm>
#include <limits>

#include "offline/bag/bag_index.hpp"
#include "offline/bag/bag_records.hpp"

namespace cortshift_tracking {

using bag::Chunk;
using bag::ChunkHead;
using bag::ChunkIndex;
using bag::Connection;
using bag::FormatError;
using bag::InnerRecord;

const char* const kDamagedBagRemedy = "copy the recording again, or try `rosbag reindex` on a copy of it";

BagFile::BagFile(const std::filesystem::path& path, const std::vector<std::string>& wanted)
    : path_(path), wanted_(wanted) {
  if (wanted.size() > 64) throw std::invalid_argument("BagFile: at most 64 topics");
  records_ = std::make_unique<bag::BagRecords>(path);
  index_ = std::make_unique<bag::BagIndex>(*records_, path_.string(), wanted_);
}

BagFile::~BagFile() = default;

std::uint64_t BagFile::size() const { return records_->size(); }
const std::vector<BagTopic>& BagFile::topics() const { return index_->topics; }
const std::map<std::string, std::uint64_t>& BagFile::compressions() const { return index_->compressions; }
const std::vector<std::string>& BagFile::remarks() const { return index_->remarks; }
const std::string& BagFile::topicOf(const BagEntry& entry) const { return index_->topics[entry.topic].name; }

ros::Time BagFile::begin() const {
  if (!index_->chunks.empty()) return index_->begin;
  std::string why;
  for (const std::string& remark : index_->remarks) why += (why.empty() ? " (" : "; ") + remark;
  throw TrackingError(path_.string() + " holds no message" + (why.empty() ? "; record again" : why + "); ") +
                      (why.empty() ? "" : kDamagedBagRemedy));
}

ros::Time BagFile::end() const {
  begin();  // says if there is none
  return index_->end;
}

std::uint64_t BagFile::messages(const std::string& name) const {
  std::uint64_t count = 0;
  for (const BagTopic& topic : topics())
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
  const ChunkHead head = records_->chunkHead(chunk.position);
  const auto asked = [&](const Connection& connection) { return connection.bit && (mask >> *connection.bit & 1) != 0; };
  const auto add = [&](const Connection& connection, const ros::Time& time, std::size_t offset) {
    if (time < chunk.begin || time > chunk.end || offset >= head.size)
      throw FormatError("an entry of its index lies outside of it; it begins", {chunk.position, {}});
    if (time >= from && time <= to)
      out.push_back(
          {time, chunk.position, static_cast<std::uint32_t>(offset), static_cast<std::uint32_t>(connection.topic)});
  };
  const std::vector<ChunkIndex> indexes = records_->indexesAfter(head);
  for (const ChunkIndex& index : indexes) {
    const Connection& connection = index_->connection(index.connection, {index.data, {}});
    if (!asked(connection)) continue;
    for (const ChunkIndex::Message& message : records_->messagesOf(index))
      add(connection, message.time, message.offset);
  }
  if (!indexes.empty()) return;
  const std::string& content = records_->content(chunk.position, head);  // a recording that broke off after it
  for (std::size_t at = 0; at < content.size();) {
    const InnerRecord inner = bag::innerRecord(content, at, chunk.position);
    if (inner.fields.op() == bag::kMessage) {
      const Connection& connection =
          index_->connection(inner.fields.number<std::uint32_t>("conn"), inner.fields.place());
      if (asked(connection)) add(connection, inner.fields.time("time"), at);
    }
    at = inner.next;
  }
} catch (const FormatError& error) {
  throw TrackingError(path_.string() + ": the chunk at " + std::to_string(secondsIn(chunk.begin)) + " s is damaged (" +
                      error.what() + "); " + kDamagedBagRemedy);
}

std::vector<BagEntry> BagFile::entries(const std::vector<std::string>& names, const ros::Time& from,
                                       const ros::Time& to) const {
  const std::uint64_t mask = maskOf(names);
  std::vector<BagEntry> out;
  for (const Chunk& chunk : index_->chunks)
    if ((chunk.mask & mask) != 0 && chunk.begin <= to && chunk.end >= from) indexOfChunk(chunk, mask, from, to, out);
  std::sort(out.begin(), out.end());
  return out;
}

std::vector<BagEntry> BagFile::lastBefore(const std::string& name, const ros::Time& time, std::size_t count) const {
  const std::uint64_t mask = maskOf({name});
  std::vector<const Chunk*> candidates;
  for (const Chunk& chunk : index_->chunks)
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

std::string BagFile::message(const BagEntry& entry, std::uint32_t at_most) const {
  try {
    const ChunkHead head = records_->chunkHead(entry.chunk);
    bag::Fields fields;
    std::string out;
    if (head.compression == "none") {  // no need to read the whole chunk
      const bag::Record found = records_->record(head.data + entry.offset);
      if (found.next() > head.next()) throw FormatError("it reaches beyond its chunk", found.fields.place());
      fields = found.fields;
      out = records_->bytes(found.data, std::min(found.data_size, at_most));
    } else {
      const InnerRecord inner = bag::innerRecord(records_->content(entry.chunk, head), entry.offset, entry.chunk);
      fields = inner.fields;
      out.assign(inner.data, std::min(inner.data_size, at_most));
    }
    if (fields.op() != bag::kMessage || fields.time("time") != entry.time ||
        index_->connection(fields.number<std::uint32_t>("conn"), fields.place()).topic != entry.topic)
      throw FormatError("it is not the one that the index says", fields.place());
    return out;
  } catch (const FormatError& error) {
    refuse(entry, error.what());
  }
}

ros::Time BagFile::stampOf(const BagEntry& entry) const {
  const std::string head = message(entry, 12);  // std_msgs/Header: seq, stamp, frame
  if (head.size() < 12) refuse(entry, "it has no header");
  try {
    return bag::timeAt(head.data() + 4, {entry.offset, entry.chunk});
  } catch (const FormatError& error) {
    refuse(entry, error.what());
  }
}

void BagFile::requireType(const BagEntry& entry, const std::string& type, const std::string& md5sum) const {
  const BagTopic& topic = topics()[entry.topic];
  if (topic.md5sum == md5sum) return;  // tf/tfMessage is the old name of tf2_msgs/TFMessage
  throw TrackingError(path_.string() + ": " + topic.name + " carries " + topic.type +
                      (topic.type == type ? " of another version" : "") + ", " + type +
                      " is needed; convert the bag with `rosbag fix`, or record that topic");
}

double BagFile::secondsIn(const ros::Time& time) const { return time.toSec() - index_->begin.toSec(); }

void BagFile::refuse(const BagEntry& entry, const std::string& reason) const {
  throw TrackingError(path_.string() + ": a message on " + topicOf(entry) + " at " +
                      std::to_string(secondsIn(entry.time)) + " s is damaged (" + reason + "); " + kDamagedBagRemedy);
}

}  // namespace cortshift_tracking
