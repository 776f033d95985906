// The phantom in place of cameras, microscope and tracked tools.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "cortshift_stereo/sources/stereo_source.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "sources/phantom/phantom_motion.hpp"

namespace cortshift_stereo {

/// Thread-safe but for fire(), which one thread calls at a time.
class PhantomSource : public StereoSource {
 public:
  /// @param stage name of the first stage; empty: the case's first
  /// @param clock tells the time of an exposure
  /// @param still_margin the microscope stands still for this long before and after each exposure [s], so that pose
  ///        samples on both sides of it are samples of the same place
  /// @throws PhantomCaseError
  PhantomSource(const cortshift_stereo_phantom::PhantomCase& description, const std::string& stage,
                const PhantomMotionSettings& motion, double still_margin, Clock clock);

  /// Renders the stage, then starts moving there. The time from which pairs are taken again.
  /// @throws PhantomCaseError for an unknown stage
  Stamp setStage(const std::string& name);

  /// Renders the present stage ahead of the first pair.
  void prepare();

  /// @throws SourceError while the microscope moves
  StereoPair fire() override;
  StereoModel calibration() const override { return scene_->stereoHead().model; }
  std::optional<OpticalSettings> settings() const override;

  const cortshift_stereo_phantom::PhantomScene& scene() const { return *scene_; }
  std::string stageName() const;
  std::string stageNameOf(int stage) const;

  /// A copy of the motion as it stands.
  PhantomMotion motion() const;

 private:
  std::shared_ptr<const cortshift_stereo_phantom::PhantomScene> scene_;
  cortshift_stereo_phantom::PhantomPairs pairs_;
  Stamp margin_;
  Clock clock_;
  mutable std::mutex mutex_;
  PhantomMotion motion_;
  Stamp last_exposure_{};
  std::uint64_t frame_ = 0;
};

}  // namespace cortshift_stereo
