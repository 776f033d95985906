// Two cameras through Aravis as one source of stereo pairs.
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>

#include "sources/aravis/aravis_camera.hpp"
#include "sources/aravis/frame_id_guard.hpp"

namespace cortshift_stereo {

struct AravisCounts {
  std::uint64_t pairs = 0;
  std::uint64_t late = 0;        ///< pairs given up because an image did not come in time
  std::uint64_t incomplete = 0;  ///< pairs given up because an image was not whole
  std::uint64_t mismatched = 0;  ///< images that were there but do not belong together
  double last_gap = 0;           ///< right exposure less left, last pair [s]
};

/// Software trigger (either camera's trigger_source is Software; the other may hang on a line that the first one's
/// exposure drives): fire() triggers, and exactly one image of each camera must follow. When one does not, the source
/// waits until both cameras are silent before it triggers again, so that no late image can pass for another.
/// Otherwise (free running, or an outside trigger) the images come by themselves and fire() gives the newest pair.
/// In both cases a pair must agree in time within sync_tolerance and keep the difference of its frame numbers.
class AravisSource : public StereoSource {
 public:
  /// @throws std::invalid_argument from AravisSettings::validate
  AravisSource(const AravisSettings& settings, const StereoModel& calibration);

  StereoPair fire() override;
  StereoModel calibration() const override { return calibration_; }
  std::optional<OpticalSettings> settings() const override { return std::nullopt; }

  CameraState leftState() const { return cameras_[0]->state(); }
  CameraState rightState() const { return cameras_[1]->state(); }
  AravisCounts counts() const;

 private:
  void receive(int side, CameraFrame frame);
  void requireConnected();
  void settle(std::unique_lock<std::mutex>& lock);
  StereoPair fireTriggered();
  StereoPair nextPair();
  StereoPair pairOf(CameraFrame left, CameraFrame right);

  const AravisSettings settings_;
  const StereoModel calibration_;
  const bool triggered_;
  FrameIdGuard guard_;
  bool settled_ = false;
  int misses_[2] = {0, 0};
  int connections_[2] = {0, 0};

  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<CameraFrame> frames_[2];
  std::chrono::steady_clock::time_point last_arrival_;
  AravisCounts counts_;
  std::unique_ptr<AravisCamera> cameras_[2];  // last: their threads use the above
};

}  // namespace cortshift_stereo
