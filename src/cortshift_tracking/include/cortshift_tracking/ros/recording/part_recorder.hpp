#pragma once

#include <rosbag/bag.h>

#include <cstddef>
#include <deque>
#include <memory>
#include <string>

#include "cortshift_tracking/ros/recording/held_messages.hpp"

namespace cortshift_tracking {

struct PartSettings {
  std::string prefix;      ///< of the files; _0000.bag and so on are appended
  double duration = 300;   ///< of one part [s]
  std::size_t parts = 24;  ///< newest parts that are kept, besides the one that is being written
  bool lz4 = true;
};

/// Writes a recording in parts, each a bag that stands alone: it begins with what still holds (HeldMessages). A part is
/// named
/// *.bag.active until it is whole.
class PartRecorder {
 public:
  PartRecorder(PartSettings settings, HeldMessages held);
  ~PartRecorder();
  PartRecorder(const PartRecorder&) = delete;
  PartRecorder& operator=(const PartRecorder&) = delete;

  /// @throws rosbag::BagException where the disk does not take it
  void write(const Recorded& message);

  /// Ends the part that is being written. @throws rosbag::BagException, std::filesystem::filesystem_error
  void close();

 private:
  void begin(const ros::Time& time);

  const PartSettings settings_;
  HeldMessages held_;
  std::unique_ptr<rosbag::Bag> bag_;
  std::string path_;               ///< of the part that is being written, as it will be named
  ros::Time begin_;                ///< of that part
  int number_ = 0;                 ///< of the next part
  std::deque<std::string> whole_;  ///< parts that are kept, oldest first
};

}  // namespace cortshift_tracking
