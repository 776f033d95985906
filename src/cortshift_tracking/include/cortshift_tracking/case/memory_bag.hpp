// A bag as bytes, so that it can be written out durably.
#pragma once

#include <rosbag/bag.h>

#include <functional>
#include <string>

namespace cortshift_tracking {

/// @throws TrackingError if the bag cannot be made; what `fill` throws
std::string bagBytes(const std::function<void(rosbag::Bag&)>& fill);

}  // namespace cortshift_tracking
