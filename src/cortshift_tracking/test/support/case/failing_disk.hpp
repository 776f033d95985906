// A disk that fills up, cannot sync or cannot be read, without a disk: the program's calls into the system come here.
#pragma once

#include <atomic>

namespace failing_disk {

constexpr long kUnlimited = -1;

extern std::atomic<long> room;         ///< bytes that write(2) still takes
extern std::atomic<bool> sync_works;   ///< fsync(2) does
extern std::atomic<int> read_failure;  ///< errno of every read(2); 0: it works
extern std::atomic<int> lock_failure;  ///< errno of every flock(2); 0: it works
/// Ending of the names of files that fread(3) cannot read, as rosbag reads; empty: it reads all.
extern std::atomic<const char*> streams_that_fail;

}  // namespace failing_disk
