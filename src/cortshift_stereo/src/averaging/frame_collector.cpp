#include "cortshift_stereo/averaging/frame_collector.hpp"

#include <limits>
#include <string>
#include <utility>

namespace cortshift_stereo {

FrameCollector::FrameCollector(const ViewTolerance& tolerance) : tolerance_(tolerance) {
  tolerance_.age = std::numeric_limits<double>::infinity();  // each request says how long it waits
}

FrameCollector::Gathered FrameCollector::await(std::size_t count, std::int64_t since_ns,
                                               std::chrono::duration<double> patience) {
  if (count < 2 || count > kMostFrames)
    throw std::invalid_argument("a mean of " + std::to_string(count) + " pairs is not possible; allowed is 2 to " +
                                std::to_string(kMostFrames));
  const std::lock_guard<std::mutex> waiting(waiting_mutex_);
  std::unique_lock<std::mutex> lock(mutex_);
  since_ns_ = since_ns;
  gathered_.emplace(Gathered{ViewFrames(tolerance_, count), 0, 0});
  std::size_t seen = 0;
  while (gathered_->frames.size() < count) {
    const bool woken = offered_.wait_for(lock, patience, [&] { return closed_ || gathered_->offered > seen; });
    seen = gathered_->offered;
    if (woken && !closed_) continue;
    const std::size_t agreed = gathered_->frames.size();
    gathered_.reset();
    throw CollectionError("only " + std::to_string(agreed) + " of " + std::to_string(count) +
                          " pairs of one view came, of " + std::to_string(seen) + " pairs in all");
  }
  return *std::exchange(gathered_, std::nullopt);
}

void FrameCollector::offer(const PosedFrame& frame) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!gathered_ || frame.stamp_ns < since_ns_ || gathered_->frames.size() == gathered_->frames.capacity()) return;
    gathered_->frames.add(frame);
    gathered_->last_stamp_ns = frame.stamp_ns;
    ++gathered_->offered;
  }
  offered_.notify_all();
}

bool FrameCollector::awaited() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return gathered_.has_value();
}

void FrameCollector::close() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    closed_ = true;
  }
  offered_.notify_all();
}

}  // namespace cortshift_stereo
