#include "sources/phantom/phantom_source.hpp"

#include <algorithm>

namespace cortshift_stereo {

using cortshift_stereo_phantom::PhantomCase;
using cortshift_stereo_phantom::PhantomScene;

namespace {

int firstStage(const PhantomScene& scene, const std::string& name) { return name.empty() ? 0 : scene.stageIndex(name); }

}  // namespace

PhantomSource::PhantomSource(const PhantomCase& description, const std::string& stage,
                             const PhantomMotionSettings& motion, double still_margin, Clock clock)
    : scene_(std::make_shared<const PhantomScene>(description)),
      pairs_(scene_),
      margin_(fromSeconds(still_margin)),
      clock_(std::move(clock)),
      motion_(scene_, motion, firstStage(*scene_, stage), clock_()) {}

void PhantomSource::prepare() { pairs_.prepare(motion().stage()); }

Stamp PhantomSource::setStage(const std::string& name) {
  const int stage = scene_->stageIndex(name);
  pairs_.prepare(stage);
  const std::lock_guard<std::mutex> lock(mutex_);
  if (stage == motion_.stage()) return motion_.arrival() + margin_;
  return motion_.moveTo(stage, std::max(clock_(), last_exposure_ + margin_)) + margin_;
}

StereoPair PhantomSource::fire() {
  pairs_.prepare(motion().stage());
  StereoPair pair;
  int stage = 0;
  std::uint64_t frame = 0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    pair.stamp = clock_();
    if (!motion_.isStill(pair.stamp - margin_, pair.stamp))
      throw SourceError("the microscope moves to stage " + stageNameOf(motion_.stage()) + "; try again when it stands");
    last_exposure_ = pair.stamp;
    stage = motion_.stage();
    frame = frame_++;
  }
  cortshift_stereo_phantom::StereoImages images = pairs_.take(stage, frame);
  pair.left = images.left;
  pair.right = images.right;
  return pair;
}

std::optional<OpticalSettings> PhantomSource::settings() const {
  const auto& stage = scene_->description().stages[static_cast<std::size_t>(motion().stage())];
  return OpticalSettings{stage.magnification, stage.focal_length};
}

std::string PhantomSource::stageNameOf(int stage) const {
  return scene_->description().stages[static_cast<std::size_t>(stage)].name;
}

std::string PhantomSource::stageName() const { return stageNameOf(motion().stage()); }

PhantomMotion PhantomSource::motion() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return motion_;
}

}  // namespace cortshift_stereo
