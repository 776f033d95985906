#include "cortshift_tracking/case/stage_store.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <regex>

#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/case/patient_registration.hpp"
#include "cortshift_tracking/case/stage_key.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/field/summary.hpp"

namespace cortshift_tracking {
namespace {

namespace fs = std::filesystem;

const char* const kLockName = ".lock";
/// A stage's, whole or damaged; other bags, such as a recording of /shift/field, are none of the store's business.
const std::regex kNumber("^([0-9]{4,9})_");
const std::regex kStageName(std::string("([0-9]{4,9})_(") + kKeyPattern + ")_([0-9a-f]{8})\\.bag");

std::string stageName(unsigned number, const std::string& key, std::uint32_t crc) {
  char text[96];
  std::snprintf(text, sizeof text, "%04u_%s_%08x.bag", number, key.c_str(), crc);
  return text;
}

void requireWhole(const fs::path& path) {
  std::smatch parts;
  const std::string name = path.filename().string();
  if (!std::regex_match(name, parts, kStageName)) throw TrackingError("its name is not that of a stage");
  const std::string bytes = readWhole(path);
  if (crc32(bytes.data(), bytes.size()) != std::stoul(parts[3].str(), nullptr, 16))
    throw TrackingError("its content does not have the checksum in its name");
}

/// What stands for a stage that cannot be read.
cortshift_msgs::StageInfo unreadableInfo(const std::string& key, const std::string& reason) {
  cortshift_msgs::StageInfo info;
  info.key = key;
  info.note = "cannot be read now: " + reason;
  info.settings.magnification = info.settings.focal_length = kUnknown;
  info.camera_pose = info.registration = unknownPose();
  return info;
}

}  // namespace

StageStore::StageStore(const fs::path& folder) : folder_(fs::absolute(folder).lexically_normal()) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (!fs::is_directory(folder_))
    throw TrackingError("case folder " + folder_.string() + " cannot be created (" + error.message() +
                        "); set case_folder to one that can");
  lockFolder();
  scan();
}

StageStore::~StageStore() {
  if (lock_ >= 0) ::close(lock_);
}

void StageStore::lockFolder() {
  lock_ = ::open((folder_ / kLockName).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock_ < 0) {  // a case on a read-only medium can still be looked at
    warnings_.push_back("it cannot be written (" + std::string(std::strerror(errno)) +
                        "): its stages can be used but none can be captured");
    return;
  }
  if (::flock(lock_, LOCK_EX | LOCK_NB) == 0) return;
  const int failure = errno;
  ::close(lock_);
  lock_ = -1;
  if (failure == EWOULDBLOCK)
    throw TrackingError("case folder " + folder_.string() +
                        " is in use by another process; stop that one or set case_folder to another");
  // Some network and user-space file systems have no locks: a case there is better used than refused.
  warnings_.push_back("that nobody else uses it cannot be made sure (" + std::string(std::strerror(failure)) +
                      "): let no other process use it, or set case_folder to a folder of this machine's disk");
}

void StageStore::scan() {
  std::vector<fs::path> files;
  for (const char* part : {"", "deleted", "set_aside"}) {
    std::error_code error;
    const fs::directory_iterator content(folder_ / part, error);
    if (error && *part == '\0')
      throw TrackingError("case folder " + folder_.string() + " cannot be read: " + error.message());
    for (const fs::directory_entry& file : content) {
      std::smatch parts;
      const std::string name = file.path().filename().string();
      // Numbers are not used twice, so that the order of capture holds for what is restored by hand.
      const bool numbered = std::regex_search(name, parts, kNumber);
      if (numbered) last_number_ = std::max(last_number_, static_cast<unsigned>(std::stoul(parts[1].str())));
      const fs::path ending = file.path().extension();
      if (*part == '\0' && numbered && (ending == ".bag" || ending == kPartialEnding)) files.push_back(file.path());
    }
  }
  std::sort(files.begin(), files.end());
  for (const fs::path& path : files) {
    if (path.extension() == kPartialEnding) {
      std::smatch parts;
      const std::string name = path.stem().string();
      if (!std::regex_match(name, parts, kStageName)) continue;
      std::error_code ignored;  // a capture that was never acknowledged
      if (fs::remove(path, ignored))
        warnings_.push_back("removed " + path.filename().string() + ", left by a capture that was interrupted");
      continue;
    }
    try {
      requireWhole(path);
      const StageRecord record = stageFromBag(path);
      std::smatch parts;
      const std::string name = path.filename().string();
      std::regex_match(name, parts, kStageName);
      if (record.info.key != parts[2].str())
        throw TrackingError("its key is '" + record.info.key + "', unlike its name");
      for (const Entry& entry : entries_)
        if (entry.info.key == record.info.key)
          throw TrackingError("its key is that of " + entry.path.filename().string() + " too");
      entries_.push_back({path, record.info, ""});
    } catch (const UnreadableFile& error) {
      std::smatch parts;
      const std::string name = path.filename().string();
      std::regex_match(name, parts, kStageName);
      entries_.push_back({path, unreadableInfo(parts[2].str(), error.what()), error.what()});
    } catch (const std::exception& error) {
      putAside(path, error.what());
    }
  }
}

void StageStore::putAside(const fs::path& path, const std::string& reason) {
  std::string where = "it is left where it is";
  try {
    where = "it is set aside as " + moveAside(folder_, path).string();
  } catch (const std::exception&) {
    // A read-only folder: naming the file is all that can be done.
  }
  set_aside_.push_back(path.filename().string() + ": " + reason + "; " + where);
}

std::vector<cortshift_msgs::StageInfo> StageStore::list() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  std::vector<cortshift_msgs::StageInfo> infos;
  for (const Entry& entry : entries_) infos.push_back(entry.info);
  return infos;
}

std::size_t StageStore::indexLocked(const std::string& key) const {
  requireKey(key);
  std::string keys;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (entries_[i].info.key == key) return i;
    keys += (keys.empty() ? "" : ", ") + entries_[i].info.key;
  }
  throw TrackingError("there is no stage '" + key + "'; " +
                      (keys.empty() ? "none has been captured yet" : "there are: " + keys));
}

cortshift_msgs::StageInfo StageStore::infoOf(const std::string& key) const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return entries_[indexLocked(key)].info;
}

std::size_t StageStore::indexOf(const std::string& key) const {
  const std::lock_guard<std::mutex> guard(mutex_);
  return indexLocked(key);
}

void StageStore::requireFree(const std::string& key) const {
  requireKeyOfCapture(key);
  const std::lock_guard<std::mutex> guard(mutex_);
  for (const Entry& entry : entries_) {
    if (entry.info.key != key) continue;
    if (!entry.trouble.empty())
      throw TrackingError("stage '" + key + "' exists already, though it cannot be read now (" + entry.trouble +
                          "); choose another key");
    throw TrackingError("stage '" + key + "' exists already (stamp " + std::to_string(entry.info.stamp.toSec()) +
                        "); nothing is overwritten: choose another key or delete that stage");
  }
}

cortshift_msgs::StageInfo StageStore::add(StageRecord record) {
  requireFree(record.info.key);
  record.info.epoch = epochOf(record.info, list());
  const std::string bytes = toBag(record);
  const std::lock_guard<std::mutex> guard(mutex_);
  for (const Entry& entry : entries_)
    if (entry.info.key == record.info.key)
      throw TrackingError("stage '" + record.info.key + "' was captured by another request at the same time");
  const fs::path path = folder_ / stageName(last_number_ + 1, record.info.key, crc32(bytes.data(), bytes.size()));
  writeDurably(path, bytes.data(), bytes.size());
  ++last_number_;
  entries_.push_back({path, record.info, ""});
  return record.info;
}

StageRecord StageStore::load(const std::string& key) const {
  fs::path path;
  {
    const std::lock_guard<std::mutex> guard(mutex_);
    path = entries_[indexLocked(key)].path;
  }
  StageRecord record;
  try {
    requireWhole(path);
    record = stageFromBag(path);
  } catch (const TrackingError& error) {
    throw TrackingError("stage '" + key + "' cannot be read from " + path.string() + ": " + error.what());
  }
  const std::lock_guard<std::mutex> guard(mutex_);
  for (Entry& entry : entries_)
    if (entry.path == path && !entry.trouble.empty() && record.info.key == key) {
      entry.info = record.info;
      entry.trouble.clear();
    }
  return record;
}

void StageStore::retryUnreadable() const {
  std::vector<std::string> keys;
  {
    const std::lock_guard<std::mutex> guard(mutex_);
    for (const Entry& entry : entries_)
      if (!entry.trouble.empty()) keys.push_back(entry.info.key);
  }
  for (const std::string& key : keys) try {
      load(key);
    } catch (const TrackingError&) {  // it is still named as unreadable
    }
}

std::vector<std::string> StageStore::unreadable() const {
  const std::lock_guard<std::mutex> guard(mutex_);
  std::vector<std::string> lines;
  for (const Entry& entry : entries_)
    if (!entry.trouble.empty()) lines.push_back(entry.path.filename().string() + ": " + entry.trouble);
  return lines;
}

void StageStore::remove(const std::string& key) {
  const std::lock_guard<std::mutex> guard(mutex_);
  const std::size_t index = indexLocked(key);
  moveAside(folder_, entries_[index].path, "deleted");
  entries_.erase(entries_.begin() + static_cast<std::ptrdiff_t>(index));
}

}  // namespace cortshift_tracking
