#include "cortshift_stereo/reconstruction_limits.hpp"

#include <algorithm>

namespace cortshift_stereo {
std::string ReconstructionLimit::option() const {
  std::string out = name;
  std::replace(out.begin(), out.end(), '_', '-');
  return out;
}

const std::vector<ReconstructionLimit>& reconstructionLimits() {
  using Settings = ReconstructionSettings;
  static const std::vector<ReconstructionLimit> limits{
      {"min_working_distance", &Settings::min_working_distance, nullptr, 0.02, 10,
       "nearest surface along the optical axis [m]"},
      {"max_working_distance", &Settings::max_working_distance, nullptr, 0.02, 100, "farthest one [m]"},
      {"relief", &Settings::relief, nullptr, 0, 1, "depth beyond what the coarse match finds, on either side [m]"},
      {"max_deviation", &Settings::max_deviation, nullptr, 0.01, 10,
       "points that may be farther off are left out [px]"},
      {"min_coverage", nullptr, &PairLimits::min_coverage, 0, 1,
       "least share with a point of what the camera shows of the rectified image"},
      {"max_epipolar_residual", nullptr, &PairLimits::max_epipolar_residual, 0.05, 100,
       "largest scatter of the vertical gaps between matched points [px]"},
      {"max_misalignment", nullptr, &PairLimits::max_misalignment, 0, 20,
       "largest disagreement of the rows by a turn of the right camera that is taken out [px]"},
      {"max_sharpness_ratio", nullptr, &PairLimits::max_sharpness_ratio, 1, 100,
       "how many times as much detail one image may have as the other"},
      {"max_saturated_share", nullptr, &PairLimits::max_saturated_share, 0, 1, "largest share of saturated pixels"},
      {"min_contrast", nullptr, &PairLimits::min_contrast, 0, 128,
       "least standard deviation of the luminance [grey levels]"},
      {"min_sharpness", nullptr, &PairLimits::min_sharpness, 0, 10, "least detail of 2-4 px over detail of 8-16 px"}};
  return limits;
}

}  // namespace cortshift_stereo
