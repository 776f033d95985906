// Recorded images in place of the cameras.
#pragma once

#include <string>
#include <vector>

#include "cortshift_stereo/images/bit_depth.hpp"
#include "cortshift_stereo/sources/stereo_source.hpp"

namespace cortshift_stereo {

/// Pairs of a folder in the order of their names. The name of a left image holds "left"; with "right" in its place it
/// is the right image's. Every fire() reads one pair and stamps it with the present time.
class FolderSource : public StereoSource {
 public:
  /// @param loop  begin again after the last pair; otherwise fire() throws then
  /// @param image_bits  that the cameras use of 16-bit images; 0: recognised from the values
  /// @throws std::invalid_argument if there is no folder or no pair, or an image has no partner
  FolderSource(const std::string& folder, bool loop, const StereoModel& calibration, Clock clock, int image_bits = 0);

  StereoPair fire() override;
  StereoModel calibration() const override { return calibration_; }
  std::optional<OpticalSettings> settings() const override { return std::nullopt; }

 private:
  struct Names {
    std::string left, right;
  };

  std::string folder_;
  bool loop_;
  StereoModel calibration_;
  Clock clock_;
  BitDepth depth_;
  std::vector<Names> pairs_;
  std::size_t next_ = 0;
};

}  // namespace cortshift_stereo
