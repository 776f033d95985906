// Bags made and read one at a time.
#pragma once

#include <cortshift_msgs/DisplacementField.h>
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

/// The last field on /shift/field of a bag; null: there is none.
/// @throws TrackingError if it is not a readable bag
cortshift_msgs::DisplacementFieldConstPtr lastField(const std::filesystem::path& path);

}  // namespace cortshift_tracking
