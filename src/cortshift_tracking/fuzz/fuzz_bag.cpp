// Recorded bags: index, topics, times, and every message of three types.
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <tf2_msgs/TFMessage.h>

#include "bytes_as_file.hpp"
#include "cortshift_tracking/offline/bag/bag_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cortshift_tracking;
  const std::vector<std::string> topics = {"/stereo/left/camera_info", "/stereo/left/image_raw/compressed", "/tf"};
  const BytesAsFile file(data, size);
  try {
    const BagFile bag(file.path(), topics);
    const ros::Time begin = bag.begin(), end = bag.end();
    bag.lastBefore(topics[0], end, 3);
    for (const BagEntry& entry : bag.entries(topics, begin, end)) {
      try {
        if (bag.topicOf(entry) == topics[0])
          bag.read<sensor_msgs::CameraInfo>(entry);
        else if (bag.topicOf(entry) == topics[1])
          bag.stampOf(entry), bag.read<sensor_msgs::CompressedImage>(entry);
        else
          bag.read<tf2_msgs::TFMessage>(entry);
      } catch (const TrackingError&) {
      }
    }
  } catch (const TrackingError&) {
  }
  return 0;
}
