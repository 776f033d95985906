// Messages of other programs, from their bytes to what the cores take. The first byte says of which type.
#include <ros/serialization.h>

#include <opencv2/core/utils/logger.hpp>

#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/offline/bag/checked_stream.hpp"

namespace {

template <typename Message, typename Use>
void digest(const std::uint8_t* data, std::size_t size, const Use& use) {
  Message message;
  cortshift_tracking::CheckedStream stream(const_cast<std::uint8_t*>(data), static_cast<std::uint32_t>(size));
  ros::serialization::deserialize(stream, message);
  use(message);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cortshift_stereo;
  if (size < 1) return 0;
  static const auto quiet = cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  static_cast<void>(quiet);
  try {
    switch (data[0] % 5) {
      case 0:
        digest<sensor_msgs::PointCloud2>(data + 1, size - 1, [](const auto& m) { surfaceFromPointCloud2(m); });
        break;
      case 1:
        digest<sensor_msgs::CameraInfo>(data + 1, size - 1, [](const auto& m) { stereoModelFromInfo(m, m); });
        break;
      case 2:
        digest<sensor_msgs::CameraInfo>(data + 1, size - 1, [](const auto& m) { cameraModelFromInfo(m); });
        break;
      case 3:
        digest<sensor_msgs::Image>(data + 1, size - 1, [](const auto& m) { bgrFromImage(m); });
        break;
      default:
        digest<sensor_msgs::CompressedImage>(data + 1, size - 1, [](const auto& m) { bgrFromImage(m); });
        break;
    }
  } catch (const std::exception&) {  // refused: each layer has its own kind
  }
  return 0;
}
