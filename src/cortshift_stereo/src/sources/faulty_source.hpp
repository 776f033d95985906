// A source whose images are spoilt, to see what the graph makes of it.
#pragma once

#include <memory>
#include <string>

#include "cortshift_stereo/sources/stereo_source.hpp"

namespace cortshift_stereo {

enum class ImageFault { kNone, kBlank, kSaturated, kSwapped };

/// @throws std::invalid_argument for a name other than none, blank, saturated, swapped
ImageFault imageFaultFromName(const std::string& name);

class FaultySource : public StereoSource {
 public:
  FaultySource(std::shared_ptr<StereoSource> source, ImageFault fault) : source_(std::move(source)), fault_(fault) {}

  StereoPair fire() override;
  StereoModel calibration() const override { return source_->calibration(); }
  std::optional<OpticalSettings> settings() const override { return source_->settings(); }

 private:
  std::shared_ptr<StereoSource> source_;
  ImageFault fault_;
};

}  // namespace cortshift_stereo
