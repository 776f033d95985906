// The raw material of recent surfaces, so that a stage can be stored with what it was made from.
#pragma once

#include <cortshift_msgs/MicroscopeSettings.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <deque>
#include <mutex>
#include <vector>

#include "cortshift_tracking/case/stage_store.hpp"

namespace cortshift_tracking {

/// The last messages of a topic, found by stamp. Thread-safe.
template <typename Message>
class StampedHistory {
 public:
  using Pointer = boost::shared_ptr<Message const>;

  explicit StampedHistory(std::size_t kept) : kept_(kept) {}

  void put(const Pointer& message) {
    const std::lock_guard<std::mutex> guard(mutex_);
    messages_.push_back(message);
    if (messages_.size() > kept_) messages_.pop_front();
  }

  /// Null if there is none of exactly this stamp.
  Pointer at(const ros::Time& stamp) const {
    const std::lock_guard<std::mutex> guard(mutex_);
    for (auto it = messages_.rbegin(); it != messages_.rend(); ++it)
      if ((*it)->header.stamp == stamp) return *it;
    return {};
  }

  /// The latest that is not after `stamp`; null if there is none.
  Pointer before(const ros::Time& stamp) const {
    const std::lock_guard<std::mutex> guard(mutex_);
    Pointer latest;
    for (const Pointer& message : messages_)
      if (message->header.stamp <= stamp && (!latest || message->header.stamp >= latest->header.stamp))
        latest = message;
    return latest;
  }

 private:
  std::size_t kept_;
  mutable std::mutex mutex_;
  std::deque<Pointer> messages_;
};

/// Subscribes:
///   /stereo/{left,right}/image_raw [sensor_msgs/Image], .../image_raw/compressed [sensor_msgs/CompressedImage],
///   /stereo/{left,right}/camera_info [sensor_msgs/CameraInfo], /microscope/settings
///   [cortshift_msgs/MicroscopeSettings]
class PairHistory {
 public:
  explicit PairHistory(ros::NodeHandle& node);

  /// Puts what was seen of the pair at record.info.stamp into the record; what was not stays null.
  void fill(StageRecord& record) const;

  /// The same without the images.
  void fillCalibration(StageRecord& record) const;

 private:
  StampedHistory<sensor_msgs::Image> left_, right_;
  StampedHistory<sensor_msgs::CompressedImage> left_compressed_, right_compressed_;
  StampedHistory<sensor_msgs::CameraInfo> left_info_, right_info_;
  StampedHistory<cortshift_msgs::MicroscopeSettings> settings_;
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace cortshift_tracking
