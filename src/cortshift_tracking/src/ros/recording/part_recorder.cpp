#include "cortshift_tracking/ros/recording/part_recorder.hpp"

#include <cstdio>
#include <filesystem>
#include <utility>

namespace cortshift_tracking {
namespace {

const std::string kActive = ".active";  // as rosbag record names what is not whole

void put(rosbag::Bag& bag, const Recorded& message) {
  bag.write(message.topic, message.time, *message.message, message.connection);
}

}  // namespace

PartRecorder::PartRecorder(PartSettings settings, HeldMessages held)
    : settings_(std::move(settings)), held_(std::move(held)) {}

PartRecorder::~PartRecorder() {
  try {
    close();
  } catch (const std::exception& error) {
    ROS_ERROR("the last part of the recording is not whole: %s", error.what());
  }
}

void PartRecorder::begin(const ros::Time& time) {
  char number[16];
  std::snprintf(number, sizeof number, "_%04d.bag", number_++);
  path_ = settings_.prefix + number;
  auto bag = std::make_unique<rosbag::Bag>();
  bag->open(path_ + kActive, rosbag::bagmode::Write);
  if (settings_.lz4) bag->setCompression(rosbag::compression::LZ4);
  for (const Recorded& held : held_.at(time)) put(*bag, held);
  begin_ = time;
  bag_ = std::move(bag);
}

void PartRecorder::write(const Recorded& message) {
  const double age = bag_ ? (message.time - begin_).toSec() : 0;
  if (age < 0 || age >= settings_.duration) close();  // a clock that was set back begins a part as well
  if (!bag_) begin(message.time);
  put(*bag_, message);
  held_.keep(message);
}

void PartRecorder::close() {
  if (!bag_) return;
  const std::unique_ptr<rosbag::Bag> bag = std::move(bag_);
  bag->close();
  std::filesystem::rename(path_ + kActive, path_);
  whole_.push_back(path_);
  for (; whole_.size() > settings_.parts; whole_.pop_front()) std::filesystem::remove(whole_.front());
}

}  // namespace cortshift_tracking
