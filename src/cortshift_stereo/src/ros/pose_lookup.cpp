#include "cortshift_stereo/ros/pose_lookup.hpp"

#include <algorithm>
#include <chrono>

#include "cortshift_stereo/admission/rig_evidence.hpp"
#include "cortshift_stereo/ros/pose_tree.hpp"

namespace cortshift_stereo {

PoseLookup::PoseLookup(double max_pose_gap, double history) : tree_(max_pose_gap, history) {
  node_.setCallbackQueue(&queue_);
  // Fixed edges come from several latched publishers at once; a short queue would lose some for good.
  fixed_ = node_.subscribe<tf2_msgs::TFMessage>("/tf_static", 100,
                                                [this](const tf2_msgs::TFMessage::ConstPtr& m) { add(*m, true); });
  moving_ = node_.subscribe<tf2_msgs::TFMessage>("/tf", 1000,
                                                 [this](const tf2_msgs::TFMessage::ConstPtr& m) { add(*m, false); });
  spinner_ = std::make_unique<ros::AsyncSpinner>(1, &queue_);
  spinner_->start();
}

PoseLookup::~PoseLookup() { spinner_->stop(); }

void PoseLookup::add(const tf2_msgs::TFMessage& message, bool fixed) {
  const std::lock_guard<std::mutex> lock(mutex_);
  noticeClock();
  addTransforms(tree_, message, fixed, ros::Time::now());
  if (!fixed && !last_now_.isZero())
    for (const geometry_msgs::TransformStamped& edge : message.transforms) {
      constexpr std::size_t kNewest = 20;
      std::deque<double>& lags = lags_[withoutSlash(edge.child_frame_id)];
      lags.push_back(last_now_.toSec() - edge.header.stamp.toSec());
      if (lags.size() > kNewest) lags.pop_front();
    }
  arrived_.notify_all();
}

void PoseLookup::noticeClock() {
  const ros::Time now = ros::Time::now();
  if (now < last_now_) {
    ROS_WARN("the clock jumped back by %.3f s: poses received so far are forgotten", (last_now_ - now).toSec());
    tree_.forgetSamples();
    lags_.clear();
  }
  last_now_ = now;
}

Eigen::Isometry3d PoseLookup::lookup(const std::string& target, const std::string& source, const ros::Time& stamp,
                                     ros::WallDuration wall_timeout) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::nanoseconds(wall_timeout.toNSec());
  const auto slice = std::chrono::milliseconds(100);  // so that a node that shuts down does not hang here
  std::unique_lock<std::mutex> lock(mutex_);
  noticeClock();
  while (true) {
    try {
      return poseFrom(tree_, target, source, stamp);
    } catch (const PoseError& error) {
      if (!error.mayHeal() || !ros::ok() || std::chrono::steady_clock::now() >= deadline) throw;
    }
    arrived_.wait_until(lock, std::min(deadline, std::chrono::steady_clock::now() + slice));
  }
}

Findings PoseLookup::judge(const std::string& target, const std::string& source, const ros::Time& stamp,
                           const PoseLimits& limits) {
  const std::lock_guard<std::mutex> lock(mutex_);
  return judgePoses(tree_, target, source, stamp, limits);
}

Findings PoseLookup::judgeClock(const std::string& target, const std::string& source, const ros::Time& stamp,
                                double lag) {
  const std::lock_guard<std::mutex> lock(mutex_);
  Findings found;
  constexpr int64_t kWindow = 500000000;  // [ns] on either side
  for (const MovingEdge& edge :
       tree_.movingEdges(withoutSlash(target), withoutSlash(source), static_cast<int64_t>(stamp.toNSec()), kWindow)) {
    const auto known = lags_.find(edge.child);
    // What never moves may be stamped with what time its publisher likes.
    if (std::all_of(edge.samples.begin(), edge.samples.end(), [&edge](const EdgeSample& sample) {
          return sample.T_parent_child.matrix() == edge.samples.front().T_parent_child.matrix();
        }))
      continue;
    if (known != lags_.end() && !known->second.empty())
      found.add(checkTrackerClock(edge.parent + " -> " + edge.child,
                                  std::vector<double>(known->second.begin(), known->second.end()), lag));
  }
  return found;
}

PoseSource PoseLookup::source(ros::WallDuration wall_timeout, const PoseLimits& limits) {
  return {[this, wall_timeout](const std::string& target, const std::string& source, const ros::Time& stamp) {
            return lookup(target, source, stamp, wall_timeout);
          },
          [this, limits](const std::string& target, const std::string& source, const ros::Time& stamp) {
            return judge(target, source, stamp, limits);
          },
          [this](const std::string& target, const std::string& source, const ros::Time& stamp) {
            const std::lock_guard<std::mutex> lock(mutex_);
            return poseMotion(tree_, target, source, stamp);
          }};
}

}  // namespace cortshift_stereo
