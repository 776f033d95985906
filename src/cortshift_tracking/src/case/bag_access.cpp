#include "cortshift_tracking/case/bag_access.hpp"

#include <rosbag/view.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <mutex>

#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

std::mutex turn;  // of all bags of the process

/// A file in memory with a name that rosbag can open. A bag's destructor writes its index and so must not meet a full
/// disk; a file in memory can then be written out with every error in our own hands.
class MemoryFile {
 public:
  MemoryFile() : descriptor_(::memfd_create("bag", MFD_CLOEXEC)) {
    if (descriptor_ < 0) throw TrackingError(std::string("no memory for a bag: ") + std::strerror(errno));
  }
  ~MemoryFile() { ::close(descriptor_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  std::string path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

}  // namespace

std::string bagBytes(const std::function<void(rosbag::Bag&)>& fill) {
  const MemoryFile file;
  try {
    const std::lock_guard<std::mutex> mine(turn);
    rosbag::Bag bag(file.path(), rosbag::bagmode::Write);
    fill(bag);
    bag.close();
  } catch (const rosbag::BagException& error) {
    throw TrackingError(std::string("a bag cannot be written: ") + error.what());
  }
  return readWhole(file.path());
}

void readBag(const std::filesystem::path& path, const std::function<void(rosbag::Bag&)>& read) {
  const std::lock_guard<std::mutex> mine(turn);
  rosbag::Bag bag(path.string(), rosbag::bagmode::Read);
  read(bag);
}

cortshift_msgs::DisplacementFieldConstPtr lastField(const std::filesystem::path& path) {
  cortshift_msgs::DisplacementFieldConstPtr last;
  try {
    readBag(path, [&](rosbag::Bag& bag) {
      rosbag::View view(bag, rosbag::TopicQuery("/shift/field"));
      for (const rosbag::MessageInstance& message : view)
        last = message.instantiate<cortshift_msgs::DisplacementField>();
    });
  } catch (const std::exception& error) {  // rosbag, ROS serialisation and the allocator each have their own
    throw TrackingError(path.string() + " is not a readable bag: " + error.what());
  }
  return last;
}

}  // namespace cortshift_tracking
