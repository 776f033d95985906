// Every parameter of surface_reconstruction, each default once.
#pragma once

#include <optional>
#include <string>

#include "cortshift_stereo/calibration/settings_warp.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "cortshift_stereo/ros/parameter_source.hpp"

namespace cortshift_stereo {

/// Lengths in metres, times in seconds.
struct SurfaceReconstructionParameters {
  std::string map_frame = "pmr";              ///< frame of the published points
  std::string camera_frame = "left_optical";  ///< raw left optical frame
  double sync_tolerance = 0;                  ///< [s] largest difference of the two stamps of a pair
  double pair_timeout = 0.5;                  ///< [s] wall time that an image waits for its partner
  double max_pose_gap = 0.15;                 ///< [s] farthest tracker sample on either side of the pair's stamp
  double pose_timeout = 1.0;                  ///< [s] wall time to wait for the pose after the pair was matched
  double calibration_timeout = 1.0;           ///< [s] wall time to wait for camera_info
  double reference_magnification = 0;         ///< microscope setting that the calibration belongs to; 0: not known,
                                              ///< the first one seen with a camera_info is taken for it
  double reference_focal_length = 0;          ///< [m] the same
  double settings_tolerance = 0.005;          ///< relative difference that counts as the reference setting
  int average_pairs = 1;                      ///< a surface is the robust mean of up to so many pairs, the newest last
  double average_window = 3.0;                ///< [s] age of the oldest of them
  double average_max_translation = 0.0005;    ///< [m] movement of the camera that ends the mean
  double average_max_rotation = 0.002;        ///< [rad] the same
  ReconstructionSettings reconstruction;

  /// Empty where it is not known.
  std::optional<MicroscopeSetting> referenceSetting() const;

  /// @throws ParameterError
  static SurfaceReconstructionParameters load(const ParameterSource& source);
};

}  // namespace cortshift_stereo
