#include "cortshift_stereo/ros/reconstruction/surface_reconstruction.hpp"

#include <std_msgs/Header.h>
#include <stereo_msgs/DisparityImage.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <chrono>
#include <cmath>
#include <exception>
#include <type_traits>
#include <utility>

#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/admission/rig_evidence.hpp"
#include "cortshift_stereo/geometry/point_transform.hpp"
#include "cortshift_stereo/ros/conversions.hpp"

namespace cortshift_stereo {
namespace {

std::string text(double value) { return cortshift_flow::formatted("%.4g", value); }

std::string text(const ros::Time& stamp) { return cortshift_flow::formatted("%u.%09u", stamp.sec, stamp.nsec); }

constexpr std::size_t kImagesKept = 8;                // of each side: a surface is made within a few periods
constexpr std::chrono::milliseconds kLook{100};       // whether whoever asked for surfaces has fallen silent
constexpr std::chrono::milliseconds kLateInput{200};  // topics do not overtake one another by more

/// Image topics that somebody publishes and this node does not listen to.
std::string otherImages(const std::vector<ros::Subscriber>& own) {
  ros::master::V_TopicInfo topics;
  std::string others;
  if (!ros::master::getTopics(topics)) return others;
  for (const ros::master::TopicInfo& topic : topics) {
    const bool heard = std::any_of(own.begin(), own.end(), [&](const auto& o) { return o.getTopic() == topic.name; });
    if (!heard && topic.datatype == ros::message_traits::datatype<sensor_msgs::Image>() &&
        topic.name.find("/shift/") == std::string::npos)
      others += (others.empty() ? " Other images that are published: " : ", ") + topic.name;
  }
  return others.empty() ? others : others + "; remap them.";
}

double now() { return ros::WallTime::now().toSec(); }

}  // namespace

template <typename Message>
ros::Subscriber SurfaceReconstruction::subscribe(const std::string& topic, Side side) {
  constexpr uint32_t kQueue = 10;
  return node_.subscribe<Message>(topic, kQueue, [this, side](const boost::shared_ptr<const Message>& message) {
    if constexpr (std::is_same_v<Message, sensor_msgs::CameraInfo>) {
      const std::lock_guard<std::mutex> lock(input_mutex_);
      infos_[static_cast<std::size_t>(side)].add(message);
      input_arrived_.notify_all();
    } else if constexpr (std::is_same_v<Message, sensor_msgs::Image>) {
      receive(side, message->header.stamp, {message, nullptr});
    } else {
      receive(side, message->header.stamp, {nullptr, message});
    }
  });
}

SurfaceReconstruction::SurfaceReconstruction(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                                             const SurfaceReconstructionParameters& parameters)
    : parameters_(parameters),
      node_(node),
      poses_(parameters.max_pose_gap),
      synchroniser_(std::llround(1e9 * parameters.sync_tolerance), parameters.pair_timeout),
      reconstruction_(parameters),
      collector_(parameters.average),
      data_spinner_(1, &data_queue_),
      service_spinner_(2, &service_queue_),
      updater_(node, private_node, private_node.getNamespace()) {
  node_.setCallbackQueue(&data_queue_);
  calibrated_settings_ = reconstruction_.calibratedSettings();
  points_publisher_ = node_.advertise<sensor_msgs::PointCloud2>("surface/points", 2);
  status_publisher_ = node_.advertise<cortshift_msgs::SurfaceStatus>("surface/status", 8);
  disparity_publisher_ = node_.advertise<stereo_msgs::DisparityImage>("surface/disparity", 2);
  updater_.setHardwareID("none");
  updater_.add("surface", this, &SurfaceReconstruction::diagnose);
  for (const auto& [side, name] : {std::pair(Side::kLeft, "left"), std::pair(Side::kRight, "right")}) {
    const std::string camera = std::string("stereo/") + name;
    subscribers_.push_back(subscribe<sensor_msgs::CameraInfo>(camera + "/camera_info", side));
    subscribers_.push_back(subscribe<sensor_msgs::Image>(camera + "/image_raw", side));
    subscribers_.push_back(subscribe<sensor_msgs::CompressedImage>(camera + "/image_raw/compressed", side));
  }
  subscribers_.push_back(node_.subscribe<cortshift_msgs::MicroscopeSettings>(
      "microscope/settings", 10, [this](const cortshift_msgs::MicroscopeSettings::ConstPtr& message) {
        const std::lock_guard<std::mutex> lock(input_mutex_);
        settings_.add(message);
        input_arrived_.notify_all();
      }));
  subscribers_.push_back(
      node_.subscribe<std_msgs::Header>("surface/wanted", 10, [this](const std_msgs::Header::ConstPtr& taken) {
        const std::lock_guard<std::mutex> lock(input_mutex_);
        demand_.want(std::chrono::steady_clock::now(), taken->stamp);
        input_arrived_.notify_all();
      }));
  unpaired_timer_ =
      node_.createWallTimer(ros::WallDuration(0.1), [this](const ros::WallTimerEvent&) { reportUnpaired(); });
  diagnostics_timer_ =
      node_.createWallTimer(ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) { publishDiagnostics(); });
  worker_ = std::thread([this] { work(); });
  ros::NodeHandle services(private_node);
  services.setCallbackQueue(&service_queue_);  // a request waits for pairs
  average_service_ = services.advertiseService("average_pairs", &SurfaceReconstruction::averagePairs, this);
  data_spinner_.start();
  service_spinner_.start();
}

SurfaceReconstruction::~SurfaceReconstruction() {
  {
    const std::lock_guard<std::mutex> lock(input_mutex_);
    stop_ = true;
  }
  input_arrived_.notify_all();
  collector_.close();
  data_spinner_.stop();
  service_spinner_.stop();
  worker_.join();
}

void SurfaceReconstruction::receive(Side side, const ros::Time& stamp, const ImageMessage& image) {
  std::optional<Synchroniser::Pair> overtaken;
  {
    const std::lock_guard<std::mutex> lock(input_mutex_);
    std::map<ros::Time, Received>& images = images_[static_cast<std::size_t>(side)];
    Received& both = images[stamp];
    if (image.raw) both.image.raw = image.raw;
    if (image.compressed) both.image.compressed = image.compressed;
    if (both.time.isZero()) both.time = ros::Time::now();
    while (images.size() > kImagesKept)
      images.erase(images.begin()->first < stamp ? images.begin() : std::prev(images.end()));
    std::optional<Synchroniser::Pair> pair =
        synchroniser_.add(side, static_cast<int64_t>(stamp.toNSec()), image, now());
    if (!pair) return;
    overtaken = std::exchange(newest_, std::move(pair));
  }
  input_arrived_.notify_all();
  const std::lock_guard<std::mutex> lock(status_mutex_);
  ++pairs_received_;
  if (overtaken) ++pairs_overtaken_;
}

void SurfaceReconstruction::reportUnpaired() {
  std::vector<Synchroniser::Unpaired> unpaired;
  {
    const std::lock_guard<std::mutex> lock(input_mutex_);
    unpaired = synchroniser_.takeUnpaired(now());
  }
  for (const Synchroniser::Unpaired& image : unpaired)
    drop({"unsynchronised", image.message()}, ros::Time().fromNSec(static_cast<uint64_t>(image.stamp_ns)));
}

void SurfaceReconstruction::work() {
  while (true) {
    std::optional<Synchroniser::Pair> pair;
    {
      std::unique_lock<std::mutex> lock(input_mutex_);
      const auto waits = [this] {  // a running mean is of every pair
        return parameters_.average_pairs > 1 || collector_.awaited() || demand_.waits(std::chrono::steady_clock::now());
      };
      const auto ready = [&] { return stop_ || (newest_ && waits()); };
      while (!input_arrived_.wait_for(lock, kLook, ready)) {
      }
      if (stop_) return;
      pair = std::exchange(newest_, std::nullopt);
    }
    const ros::Time stamp = ros::Time().fromNSec(static_cast<uint64_t>(pair->stamp_ns));
    try {
      process(*pair, stamp);
    } catch (const std::exception& error) {
      drop(dropReason(error), stamp);
    }
    const std::lock_guard<std::mutex> lock(status_mutex_);
    calibrated_settings_ = reconstruction_.calibratedSettings();
  }
}

void SurfaceReconstruction::process(const Synchroniser::Pair& pair, const ros::Time& stamp) {
  const PoseSource poses(
      [this](const std::string& target, const std::string& source, const ros::Time& time) {
        // Once the camera's pose is known, all that never moves has come as well.
        const bool of_the_rig = target == parameters_.camera_frame;
        return poses_.lookup(target, source, time, ros::WallDuration(of_the_rig ? 0 : parameters_.pose_timeout));
      },
      [this](const std::string& target, const std::string& source, const ros::Time& time) {
        Findings found = poses_.judge(target, source, time, parameters_.poses);
        const ros::Time received = receivedAt(time);
        if (!received.isZero()) found.add(poses_.judgeClock(target, source, time, (received - time).toSec()));
        return found;
      });
  const PairSurface surface = reconstruct(gather(pair, stamp), poses);
  requireOneContent(stamp);
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = parameters_.map_frame;
  const cortshift_msgs::SurfaceStatus status = statusOf(header, surface.warnings);
  {
    const std::lock_guard<std::mutex> lock(input_mutex_);
    demand_.served(stamp);
  }
  status_publisher_.publish(status);
  points_publisher_.publish(boost::make_shared<sensor_msgs::PointCloud2>(toPointCloud2(surface.surface_map, header)));
  if (disparity_publisher_.getNumSubscribers() > 0) {
    header.frame_id = parameters_.camera_frame;
    disparity_publisher_.publish(toDisparityImage(surface.result.disparity, surface.frame.rectifier->model(),
                                                  surface.result.quality.search_range, header));
  }
  {
    const std::lock_guard<std::mutex> lock(status_mutex_);
    ++surfaces_published_;
    last_pair_dropped_ = false;
    last_quality_ = surface.result.quality;
    last_surface_stamp_ = stamp;
    last_seconds_ = surface.result.seconds;
    last_averaged_ = surface.averaged;
    last_warnings_ = status.warnings;
  }
  publishDiagnostics();
  collector_.offer(surface.frame);
}

ros::Time SurfaceReconstruction::receivedAt(const ros::Time& stamp) {
  const std::lock_guard<std::mutex> lock(input_mutex_);
  ros::Time received;
  for (const auto& images : images_)
    if (const auto found = images.find(stamp); found != images.end()) received = std::max(received, found->second.time);
  return received;
}

cortshift_msgs::SurfaceStatus SurfaceReconstruction::statusOf(const std_msgs::Header& header,
                                                              const std::vector<std::string>& warnings) {
  cortshift_msgs::SurfaceStatus status;
  status.header = header;
  status.warnings = warnings;
  status.parameters = parameters_.effective();
  status.received = receivedAt(header.stamp);
  if (!status.received.isZero())
    addWarnings(status.warnings, checkLag("The stamp of the pair", status.received.toSec() - header.stamp.toSec(),
                                          ClockLimits::kLive, "arrival in this node")
                                     .warnings());
  return status;
}

void SurfaceReconstruction::requireOneContent(const ros::Time& stamp) {
  ImageMessage images[2];
  {
    const std::lock_guard<std::mutex> lock(input_mutex_);
    for (std::size_t side = 0; side < 2; ++side)
      if (const auto found = images_[side].find(stamp); found != images_[side].end())
        images[side] = found->second.image;
  }
  cortshift_stereo::requireOneContent(images[0], "left");
  cortshift_stereo::requireOneContent(images[1], "right");
}

bool SurfaceReconstruction::averagePairs(cortshift_msgs::AveragePairs::Request& request,
                                         cortshift_msgs::AveragePairs::Response& response) {
  try {
    const FrameCollector::Gathered gathered =
        collector_.await(request.pairs, static_cast<std::int64_t>(request.since.toNSec()),
                         std::chrono::duration<double>(request.patience.toSec()));
    ViewFrames::Mean mean = gathered.frames.mean();
    mean.result.surface_left.points = transformPoints(mean.T_pmr_left, mean.result.surface_left.points);
    std_msgs::Header header;
    header.stamp.fromNSec(static_cast<uint64_t>(gathered.last_stamp_ns));
    header.frame_id = parameters_.map_frame;
    response.surface = toPointCloud2(mean.result.surface_left, header);
    response.status = statusOf(header, mean.warnings);
    response.success = true;
    response.message = "mean of " + std::to_string(gathered.frames.size()) + " pairs";
    if (gathered.offered > gathered.frames.size())
      response.message += "; " + std::to_string(gathered.offered - gathered.frames.size()) +
                          " more were left out, as the microscope or its setting had moved";
  } catch (const std::invalid_argument& error) {
    response.success = false;
    response.message = error.what();
  } catch (const CollectionError& error) {
    response.success = false;
    response.message = error.what();
    const std::lock_guard<std::mutex> lock(status_mutex_);
    if (last_pair_dropped_) response.message += "; the last pair was dropped: " + last_drop_->why.message;
  }
  if (!response.success) ROS_WARN_STREAM("average_pairs refused: " << response.message);
  return true;
}

PairSurface SurfaceReconstruction::reconstruct(PairMessages messages, const PoseSource& poses) {
  while (true) {
    std::optional<PairSurface> surface;
    std::exception_ptr refusal;
    try {
      surface = reconstruction_(messages, poses);
    } catch (...) {
      refusal = std::current_exception();
    }
    std::unique_lock<std::mutex> lock(input_mutex_);
    bool changed = refresh(messages);
    if (refusal)
      input_arrived_.wait_for(lock, kLateInput, [&] { return stop_ || changed || (changed = refresh(messages)); });
    if (stop_ || !changed) {
      if (refusal) std::rethrow_exception(refusal);
      return *surface;
    }
  }
}

PairMessages SurfaceReconstruction::gather(const Synchroniser::Pair& pair, const ros::Time& stamp) {
  std::unique_lock<std::mutex> lock(input_mutex_);
  const auto deadline =
      std::chrono::steady_clock::now() + std::chrono::duration<double>(parameters_.calibration_timeout);
  input_arrived_.wait_until(lock, deadline, [this] { return stop_ || !(infos_[0].empty() || infos_[1].empty()); });
  PairMessages messages{stamp, pair.left, pair.right, {}, {}, {}};
  refresh(messages);
  return messages;
}

bool SurfaceReconstruction::refresh(PairMessages& messages) const {
  const auto same = [](const sensor_msgs::CameraInfoConstPtr& a, const sensor_msgs::CameraInfoConstPtr& b) {
    return a && b ? sameCalibration(*a, *b) : a == b;
  };
  const PairMessages before =
      std::exchange(messages, {messages.stamp, messages.left, messages.right, infos_[0].at(messages.stamp),
                               infos_[1].at(messages.stamp), settings_.at(messages.stamp)});
  return !same(before.left_info, messages.left_info) || !same(before.right_info, messages.right_info) ||
         before.settings != messages.settings;
}

void SurfaceReconstruction::drop(const DropReason& why, const ros::Time& stamp) {
  ROS_WARN_STREAM("pair at " << text(stamp) << " dropped (" << why.reason << "): " << why.message);
  {
    const std::lock_guard<std::mutex> lock(status_mutex_);
    ++drops_[why.reason];
    last_drop_ = Drop{why, stamp};
    last_pair_dropped_ = true;
  }
  publishDiagnostics();
}

void SurfaceReconstruction::publishDiagnostics() {
  const std::lock_guard<std::mutex> lock(updater_mutex_);  // called from the worker and from timers
  updater_.force_update();
}

void SurfaceReconstruction::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  using diagnostic_msgs::DiagnosticStatus;
  const std::lock_guard<std::mutex> lock(status_mutex_);
  const std::string clock = clock_.trouble();
  if (!clock.empty())
    status.summary(DiagnosticStatus::WARN, clock);
  else if (last_pair_dropped_)
    status.summary(DiagnosticStatus::WARN, last_drop_->why.message);
  else if (surfaces_published_ == 0)
    status.summary(DiagnosticStatus::WARN,
                   "No stereo pair has arrived yet: check the image topics." + otherImages(subscribers_));
  else if (!last_warnings_.empty())
    status.summary(DiagnosticStatus::WARN, "The last pair gave a surface with a warning. " + last_warnings_.front());
  else
    status.summary(DiagnosticStatus::OK, "The last pair gave a surface.");
  if (!clock.empty()) ROS_WARN_STREAM_THROTTLE(30, clock);
  for (const std::string& warning : last_warnings_) status.add("warning", warning);
  status.add("last_drop_reason", last_drop_ ? last_drop_->why.reason + ": " + last_drop_->why.message : "");
  status.add("last_drop_stamp", last_drop_ ? text(last_drop_->stamp) : "");
  status.add("last_surface_stamp", surfaces_published_ > 0 ? text(last_surface_stamp_) : "");
  status.add("pairs_received", pairs_received_);
  status.add("pairs_overtaken", pairs_overtaken_);
  status.add("surfaces_published", surfaces_published_);
  for (const auto& [reason, count] : drops_) status.add("dropped_" + reason, count);
  status.add("calibrated_settings", calibrated_settings_);
  if (!last_quality_) return;
  status.add("averaged_pairs", last_averaged_);
  status.add("coverage", text(last_quality_->coverage));
  status.add("search_range_px", std::to_string(last_quality_->search_range.start) + " ... " +
                                    std::to_string(last_quality_->search_range.end));
  status.add("epipolar_residual_px", text(last_quality_->epipolar.spread));
  status.add("saturated_share_left", text(last_quality_->left.saturated_share));
  status.add("saturated_share_right", text(last_quality_->right.saturated_share));
  status.add("sharpness_left", text(last_quality_->left.sharpness));
  status.add("sharpness_right", text(last_quality_->right.sharpness));
  status.add("reconstruct_seconds", text(last_seconds_));
}

}  // namespace cortshift_stereo
