// Every parameter of surface_reconstruction, each default once.
#pragma once

#include <optional>
#include <string>

#include "cortshift_stereo/admission/limits.hpp"
#include "cortshift_stereo/averaging/view_frames.hpp"
#include "cortshift_stereo/calibration/settings/settings_warp.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "cortshift_stereo/ros/parameter_source.hpp"

namespace cortshift_stereo {

/// Lengths in metres, times in seconds.
struct SurfaceReconstructionParameters {
  std::string map_frame = "pmr";                     ///< frame of the published points
  std::string camera_frame = "left_optical";         ///< raw left optical frame
  std::string right_camera_frame = "right_optical";  ///< raw right optical frame, to compare tf with camera_info
  PoseLimits poses;                                  ///< what the samples around an exposure may be like
  double sync_tolerance = 0;                         ///< [s] largest difference of the two stamps of a pair
  double pair_timeout = 0.5;                         ///< [s] wall time that an image waits for its partner
  double max_pose_gap = 0.15;                        ///< [s] farthest tracker sample on either side of the pair's stamp
  double pose_timeout = 1.0;                         ///< [s] wall time to wait for the pose after the pair was matched
  double calibration_timeout = 1.0;                  ///< [s] wall time to wait for camera_info
  std::string settings_calibration;    ///< folder that calibrate_settings wrote; empty: the reference setting only
  double reference_magnification = 0;  ///< microscope setting that the calibration belongs to; 0: that of
                                       ///< settings_calibration, without it the first one seen
  double reference_focal_length = 0;   ///< [m] the same
  double settings_tolerance = 0.005;   ///< relative difference that counts as the reference setting
  int image_bits = 0;                  ///< that cameras use of 16-bit images, 8 to 16; 0: recognised (BitDepth)
  int average_pairs = 1;               ///< a surface is the robust mean of up to so many pairs, the newest last
  ViewTolerance average;               ///< what these pairs may differ by
  ReconstructionSettings reconstruction;

  /// Empty where it is not known.
  std::optional<MicroscopeSetting> referenceSetting() const;

  /// All of them as text, equal where they are equal; see ParameterWriter.
  std::string effective() const;

  /// @throws ParameterError
  static SurfaceReconstructionParameters load(const ParameterSource& source);
};

}  // namespace cortshift_stereo
