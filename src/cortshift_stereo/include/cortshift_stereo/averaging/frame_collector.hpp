// Gathers coming frames of one view for whoever waits for their mean.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <stdexcept>

#include "cortshift_stereo/averaging/view_frames.hpp"

namespace cortshift_stereo {

/// The frames that were asked for did not come. The message says how many did.
class CollectionError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// One thread offers frames, another waits; one who waits at a time, later ones queue.
class FrameCollector {
 public:
  static constexpr std::size_t kMostFrames = 64;  ///< of one request

  explicit FrameCollector(const ViewTolerance& tolerance);

  struct Gathered {
    ViewFrames frames;
    std::size_t offered = 0;  ///< frames in all, those of another view among them
    std::int64_t last_stamp_ns = 0;
  };

  /// Waits until `count` frames of one view have come.
  /// @param since_ns  frames of earlier stamps do not count
  /// @param patience  longest wait for the next frame
  /// @throws CollectionError, std::invalid_argument for a count that is not 2 ... kMostFrames
  Gathered await(std::size_t count, std::int64_t since_ns, std::chrono::duration<double> patience);

  void offer(const PosedFrame& frame);

  /// Whether somebody waits.
  bool awaited() const;

  /// Whoever waits, now or later, is refused.
  void close();

 private:
  ViewTolerance tolerance_;
  std::mutex waiting_mutex_;  // held by the one who waits
  mutable std::mutex mutex_;
  std::condition_variable offered_;
  std::optional<Gathered> gathered_;
  std::int64_t since_ns_ = 0;
  bool closed_ = false;
};

}  // namespace cortshift_stereo
