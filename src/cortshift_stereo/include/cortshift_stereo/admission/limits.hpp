// Limits of the checks beside those of the images. Each default is written here and nowhere else.
#pragma once

namespace cortshift_stereo {

/// Of the poses around an exposure. The tracker's data sheet says what they may be.
struct PoseLimits {
  /// [m] root mean square deviation of one tracked position from steady motion, where the camera looks. 0.25 mm is the
  /// volumetric accuracy (RMS) that NDI's data sheet gives for the Polaris Spectra; what it trembles by is less.
  double tracker_jitter = 0.00025;
  static constexpr double kRefusedJitter = 4;    ///< times tracker_jitter: no tracker but a fault
  static constexpr double kWindow = 0.25;        ///< [s] on either side of the exposure
  static constexpr double kSamePlace = 1e-6;     ///< [m] rounding of what is said twice
  static constexpr double kSameRotation = 1e-6;  ///< [rad] the same
};

/// Of clocks.
struct ClockLimits {
  static constexpr double kTransport = 0.25;   ///< [s] from an exposure to its record: read-out, network, disk
  static constexpr double kLive = 2.0;         ///< [s] the same in a running graph, where a simulated camera renders
  static constexpr double kAhead = 0.5;        ///< [s] that two clocks may be apart and images take, together
  static constexpr double kRecording = 86400;  ///< [s] no recording lasts longer
};

/// Of tf and camera_info about the stereo head: rounding of what calibrate_stereo writes into the two, and the two
/// principal points of a rectification of its own.
struct StereoEdgeLimits {
  static constexpr double kPlace = 0.0005;    ///< [m]
  static constexpr double kRotation = 0.001;  ///< [rad]
};

}  // namespace cortshift_stereo
