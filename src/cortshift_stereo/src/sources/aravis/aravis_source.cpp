#include "sources/aravis/aravis_source.hpp"

#include <cmath>
#include <future>

namespace cortshift_stereo {
namespace {

const char* const kSides[2] = {"left", "right"};
constexpr std::size_t kQueue = 8;
constexpr int kMissesToReconnect = 3;
constexpr int kConfirmations = 2;  // free running: one pair of a new frame number difference could be chance

std::chrono::steady_clock::duration seconds(double value) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(value));
}

}  // namespace

AravisSource::AravisSource(const AravisSettings& settings, const StereoModel& calibration)
    : settings_((settings.validate(), settings)),
      calibration_(calibration),
      triggered_(settings.left.trigger_source == "Software" || settings.right.trigger_source == "Software"),
      guard_(triggered_ ? FrameIdGuard(1, FrameIdGuard::kNever) : FrameIdGuard(kConfirmations, kConfirmations)) {
  const AravisCameraSettings* own[2] = {&settings_.left, &settings_.right};
  for (int side = 0; side < 2; ++side)
    cameras_[side] = std::make_unique<AravisCamera>(
        kSides[side], *own[side], settings_, [this, side](CameraFrame frame) { receive(side, std::move(frame)); });
}

AravisCounts AravisSource::counts() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return counts_;
}

void AravisSource::receive(int side, CameraFrame frame) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    frames_[side].push_back(std::move(frame));
    if (frames_[side].size() > kQueue) frames_[side].pop_front();
    last_arrival_ = std::chrono::steady_clock::now();
  }
  arrived_.notify_all();
}

void AravisSource::requireConnected() {
  const CameraState states[2] = {leftState(), rightState()};
  for (int side = 0; side < 2; ++side)
    if (!states[side].connected)
      throw SourceError(states[side].fault.empty() ? std::string(kSides[side]) + " camera: connecting"
                                                   : states[side].fault);
  if (std::abs(states[0].gain - states[1].gain) > 1e-6 + 0.01 * std::abs(settings_.gain))
    throw SourceError("the cameras' gains differ (" + std::to_string(states[0].gain) + " and " +
                      std::to_string(states[1].gain) + "); choose one that both can do");
  for (int side = 0; side < 2; ++side)
    if (states[side].connections != connections_[side]) {
      connections_[side] = states[side].connections;
      misses_[side] = 0;
      settled_ = false;
    }
}

StereoPair AravisSource::fire() {
  requireConnected();
  return triggered_ ? fireTriggered() : nextPair();
}

/// Waits until nothing is under way any more, and forgets what came.
void AravisSource::settle(std::unique_lock<std::mutex>& lock) {
  const auto quiet = seconds(settings_.frame_retention + 2 * settings_.exposure);
  const auto start = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() < std::max(last_arrival_, start) + quiet) {
    if (std::chrono::steady_clock::now() > start + 10 * quiet)
      throw SourceError("the cameras send images that nobody triggered; check trigger_source and the trigger lines");
    arrived_.wait_until(lock, std::max(last_arrival_, start) + quiet);
  }
  guard_.reset();
  settled_ = true;
}

StereoPair AravisSource::fireTriggered() {
  std::unique_lock<std::mutex> lock(mutex_);
  if (!settled_) settle(lock);
  if (!frames_[0].empty() || !frames_[1].empty()) {
    counts_.mismatched += frames_[0].size() + frames_[1].size();
    settle(lock);
  }
  for (auto& frames : frames_) frames.clear();
  settled_ = false;  // until this trigger's images are accounted for
  lock.unlock();
  const AravisCameraSettings* own[2] = {&settings_.left, &settings_.right};
  std::future<void> triggers[2];  // both at once
  for (int side = 0; side < 2; ++side)
    if (own[side]->trigger_source == "Software")
      triggers[side] = std::async(std::launch::async, [this, side] { cameras_[side]->softwareTrigger(); });
  for (auto& trigger : triggers)
    if (trigger.valid()) trigger.get();
  lock.lock();
  const bool complete = arrived_.wait_for(lock, seconds(settings_.timeout),
                                          [this] { return !frames_[0].empty() && !frames_[1].empty(); });
  for (int side = 0; side < 2; ++side) {
    misses_[side] = frames_[side].empty() ? misses_[side] + 1 : 0;
    if (misses_[side] >= kMissesToReconnect)
      cameras_[side]->reconnect(std::string(kSides[side]) + " camera: no image after " + std::to_string(misses_[side]) +
                                " triggers");
  }
  if (!complete) {
    ++counts_.late;
    std::string sides;
    for (int side = 0; side < 2; ++side)
      if (frames_[side].empty()) sides += (sides.empty() ? "" : " and ") + std::string(kSides[side]);
    throw SourceError("no image from the " + sides + " camera within " + std::to_string(settings_.timeout) +
                      " s of the trigger");
  }
  if (frames_[0].size() > 1 || frames_[1].size() > 1) {
    counts_.mismatched += 2;
    throw SourceError("more than one image came for one trigger");
  }
  CameraFrame left = std::move(frames_[0].front()), right = std::move(frames_[1].front());
  for (auto& frames : frames_) frames.clear();
  settled_ = true;
  if (left.image.empty() || right.image.empty()) {
    ++counts_.incomplete;
    throw SourceError(std::string("the ") + (left.image.empty() ? "left" : "right") +
                      " image did not arrive whole; check cable, packet size and network buffers");
  }
  const double gap = toSeconds(right.stamp - left.stamp);
  const bool same_number = guard_.accept(left.id, right.id);
  if (std::abs(gap) > settings_.sync_tolerance || !same_number) {
    counts_.mismatched += 2;
    settled_ = same_number;
    throw SourceError("the two images do not belong together: exposed " + std::to_string(1000 * gap) +
                      " ms apart, frames " + std::to_string(left.id) + " and " + std::to_string(right.id));
  }
  ++counts_.pairs;
  counts_.last_gap = gap;
  return pairOf(std::move(left), std::move(right));
}

StereoPair AravisSource::nextPair() {
  std::unique_lock<std::mutex> lock(mutex_);
  if (!settled_) {
    for (auto& frames : frames_) frames.clear();
    guard_.reset();
    settled_ = true;
  }
  const auto end = std::chrono::steady_clock::now() + seconds(settings_.timeout);
  const Stamp tolerance = fromSeconds(settings_.sync_tolerance);
  for (;;) {
    std::optional<StereoPair> newest;
    while (!frames_[0].empty() && !frames_[1].empty()) {
      const Stamp gap = frames_[1].front().stamp - frames_[0].front().stamp;
      const bool left_whole = !frames_[0].front().image.empty(), right_whole = !frames_[1].front().image.empty();
      if (!left_whole || !right_whole) {
        ++counts_.incomplete;
        frames_[left_whole ? 1 : 0].pop_front();
      } else if (gap > tolerance || gap < -tolerance) {
        ++counts_.mismatched;
        frames_[gap > tolerance ? 0 : 1].pop_front();
      } else {
        CameraFrame left = std::move(frames_[0].front()), right = std::move(frames_[1].front());
        frames_[0].pop_front();
        frames_[1].pop_front();
        if (!guard_.accept(left.id, right.id)) {
          counts_.mismatched += 2;
          continue;
        }
        counts_.last_gap = toSeconds(gap);
        newest = pairOf(std::move(left), std::move(right));
      }
    }
    if (newest) {
      ++counts_.pairs;
      return *newest;
    }
    if (arrived_.wait_until(lock, end) == std::cv_status::timeout) break;
  }
  ++counts_.late;
  throw SourceError("no pair within " + std::to_string(settings_.timeout) +
                    " s; the last images: " + std::to_string(frames_[0].size()) + " left, " +
                    std::to_string(frames_[1].size()) + " right. Check the trigger and sync_tolerance");
}

StereoPair AravisSource::pairOf(CameraFrame left, CameraFrame right) {
  const cv::Size sizes[2] = {calibration_.left.size, calibration_.right.size};
  const cv::Mat* images[2] = {&left.image, &right.image};
  for (int side = 0; side < 2; ++side)
    if (images[side]->size() != sizes[side])
      throw SourceError(std::string("the ") + kSides[side] + " camera gives " + std::to_string(images[side]->cols) +
                        " x " + std::to_string(images[side]->rows) + " pixels, its calibration is for " +
                        std::to_string(sizes[side].width) + " x " + std::to_string(sizes[side].height));
  return {std::move(left.image), std::move(right.image), left.stamp + (right.stamp - left.stamp) / 2};
}

}  // namespace cortshift_stereo
