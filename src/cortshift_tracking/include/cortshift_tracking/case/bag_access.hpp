// Bags made and read one at a time.
#pragma once

#include <rosbag/bag.h>

#include <filesystem>
#include <functional>
#include <string>

namespace cortshift_tracking {

// A rosbag::Bag loads a plugin when it is made and unloads it when it ends. Where two threads do so at the same time
// one of them finds the plugin gone and the process crashes: here they take turns.

/// A bag as bytes, so that it can be written out durably.
/// @param fill  must not use another bag
/// @throws TrackingError if the bag cannot be made; what `fill` throws
std::string bagBytes(const std::function<void(rosbag::Bag&)>& fill);

/// @param read  must not use another bag
/// @throws what rosbag throws, for instance rosbag::BagException; what `read` throws
void readBag(const std::filesystem::path& path, const std::function<void(rosbag::Bag&)>& read);

}  // namespace cortshift_tracking
