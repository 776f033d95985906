#include "cortshift_tracking/ros/tracker/pair_history.hpp"

#include <string>

namespace cortshift_tracking {
namespace {

constexpr std::size_t kImages = 16, kSmall = 256;  // 16 pairs: 4 s at 4 Hz, 75 MB at 1024 x 768

}  // namespace

PairHistory::PairHistory(ros::NodeHandle& node)
    : left_(kImages),
      right_(kImages),
      left_compressed_(kImages),
      right_compressed_(kImages),
      left_info_(kSmall),
      right_info_(kSmall),
      settings_(kSmall) {
  const auto listen = [&](const std::string& topic, auto& history) {
    using Pointer = typename std::decay_t<decltype(history)>::Pointer;
    using Message = std::remove_const_t<typename Pointer::element_type>;
    subscribers_.push_back(node.subscribe<Message>(
        topic, 8, boost::function<void(const Pointer&)>([&history](const Pointer& message) { history.put(message); })));
  };
  listen("stereo/left/image_raw", left_);
  listen("stereo/right/image_raw", right_);
  listen("stereo/left/image_raw/compressed", left_compressed_);
  listen("stereo/right/image_raw/compressed", right_compressed_);
  listen("stereo/left/camera_info", left_info_);
  listen("stereo/right/camera_info", right_info_);
  listen("microscope/settings", settings_);
}

void PairHistory::fill(StageRecord& record) const {
  const ros::Time& stamp = record.info.stamp;
  record.left = left_.at(stamp);
  record.right = right_.at(stamp);
  record.left_compressed = left_compressed_.at(stamp);
  record.right_compressed = right_compressed_.at(stamp);
  fillCalibration(record);
}

void PairHistory::fillCalibration(StageRecord& record) const {
  const ros::Time& stamp = record.info.stamp;
  record.left_info = left_info_.before(stamp);  // published with each pair, or once
  record.right_info = right_info_.before(stamp);
  record.settings = settings_.before(stamp);
}

}  // namespace cortshift_tracking
