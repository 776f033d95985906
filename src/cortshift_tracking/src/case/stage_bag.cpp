#include <rosbag/view.h>
#include <std_msgs/String.h>

#include <new>

#include "cortshift_tracking/case/bag_access.hpp"
#include "cortshift_tracking/case/durable_file.hpp"
#include "cortshift_tracking/case/stage_store.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

template <typename Message>
void write(rosbag::Bag& bag, const char* topic, const ros::Time& stamp,
           const boost::shared_ptr<Message const>& message) {
  if (message) bag.write(topic, stamp, *message);
}

template <typename Message>
void read(const rosbag::MessageInstance& instance, const char* topic, boost::shared_ptr<Message const>& out) {
  if (instance.getTopic() == topic) out = instance.instantiate<Message>();
}

/// Whether it is the file's content that rosbag or ROS serialisation refuses.
bool isOfContent(const std::exception& error) {
  return dynamic_cast<const rosbag::BagFormatException*>(&error) != nullptr ||
         dynamic_cast<const rosbag::BagUnindexedException*>(&error) != nullptr ||
         dynamic_cast<const ros::serialization::StreamOverrunException*>(&error) != nullptr;
}

}  // namespace

std::string toBag(const StageRecord& record) {
  const ros::Time stamp = std::max(record.info.stamp, ros::TIME_MIN);
  return bagBytes([&](rosbag::Bag& bag) {
    bag.write("/stage/info", stamp, record.info);
    bag.write("/surface/points", stamp, *record.surface);
    write(bag, "/stereo/left/image_raw", stamp, record.left);
    write(bag, "/stereo/right/image_raw", stamp, record.right);
    write(bag, "/stereo/left/image_raw/compressed", stamp, record.left_compressed);
    write(bag, "/stereo/right/image_raw/compressed", stamp, record.right_compressed);
    write(bag, "/stereo/left/camera_info", stamp, record.left_info);
    write(bag, "/stereo/right/camera_info", stamp, record.right_info);
    write(bag, "/microscope/settings", stamp, record.settings);
    if (!record.parameters.empty()) {
      std_msgs::String parameters;
      parameters.data = record.parameters;
      bag.write("/stage/parameters", stamp, parameters);
    }
    if (!record.tf.transforms.empty()) bag.write("/tf", stamp, record.tf);
    if (!record.tf_static.transforms.empty()) bag.write("/tf_static", stamp, record.tf_static);
  });
}

StageRecord stageFromBag(const std::filesystem::path& path) {
  StageRecord record;
  cortshift_msgs::StageInfoConstPtr info;
  tf2_msgs::TFMessageConstPtr tf, tf_static;
  std_msgs::StringConstPtr parameters;
  try {
    readBag(path, [&](rosbag::Bag& bag) {
      rosbag::View view(bag);
      for (const rosbag::MessageInstance& instance : view) {
        read(instance, "/stage/info", info);
        if (instance.getTopic() == "/stage/info" && !info)
          throw TrackingError("it is of an older version of this software (" + instance.getDataType() +
                              " has changed since); process its recording again, or use the version that wrote it");
        read(instance, "/stage/parameters", parameters);
        read(instance, "/surface/points", record.surface);
        read(instance, "/stereo/left/image_raw", record.left);
        read(instance, "/stereo/right/image_raw", record.right);
        read(instance, "/stereo/left/image_raw/compressed", record.left_compressed);
        read(instance, "/stereo/right/image_raw/compressed", record.right_compressed);
        read(instance, "/stereo/left/camera_info", record.left_info);
        read(instance, "/stereo/right/camera_info", record.right_info);
        read(instance, "/microscope/settings", record.settings);
        read(instance, "/tf", tf);
        read(instance, "/tf_static", tf_static);
      }
    });
  } catch (const TrackingError& error) {
    throw TrackingError(path.string() + ": " + error.what());
  } catch (const std::bad_alloc&) {
    throw UnreadableFile("cannot read " + path.string() + ": no memory");
  } catch (const std::exception& error) {
    if (isOfContent(error)) throw TrackingError(path.string() + " is not a readable bag: " + error.what());
    throw UnreadableFile("cannot read " + path.string() + ": " + error.what());  // the disk, or rosbag's plugins
  }
  if (!info || !record.surface) throw TrackingError(path.string() + " holds no stage (/stage/info, /surface/points)");
  record.info = *info;
  if (parameters) record.parameters = parameters->data;
  if (tf) record.tf = *tf;
  if (tf_static) record.tf_static = *tf_static;
  return record;
}

}  // namespace cortshift_tracking
