// Where stereo pairs come from: the phantom, or a pair of cameras on a microscope. Knows no ROS.
#pragma once

#include <chrono>
#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>

#include "cortshift_stereo/geometry/camera_model.hpp"

namespace cortshift_stereo {

/// A pair that could not be taken. The message says why and what to do.
class SourceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Time since the epoch of ROS time.
using Stamp = std::chrono::nanoseconds;
using Clock = std::function<Stamp()>;

inline double toSeconds(Stamp stamp) { return std::chrono::duration<double>(stamp).count(); }
inline Stamp fromSeconds(double seconds) {
  return std::chrono::duration_cast<Stamp>(std::chrono::duration<double>(seconds));
}

/// Two images exposed at the same instant.
struct StereoPair {
  cv::Mat left;   ///< CV_8UC3 blue green red, raw
  cv::Mat right;  ///< same size and type
  Stamp stamp{};  ///< middle of the exposure
};

/// Settings of the microscope's optics.
struct OpticalSettings {
  double magnification = 1;   ///< zoom factor
  double focal_length = 0.3;  ///< of the main objective [m]
};

class StereoSource {
 public:
  StereoSource() = default;
  StereoSource(const StereoSource&) = delete;
  StereoSource& operator=(const StereoSource&) = delete;
  virtual ~StereoSource() = default;

  /// Fires both cameras together and returns when both images are there. Not called from two threads at a time.
  /// @throws SourceError
  virtual StereoPair fire() = 0;

  /// Calibration that belongs to the pairs.
  virtual StereoModel calibration() const = 0;

  /// Present settings; nothing where the microscope does not report them.
  virtual std::optional<OpticalSettings> settings() const = 0;
};

}  // namespace cortshift_stereo
