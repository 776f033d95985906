// Reconstructions of one view, gathered for their mean.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "cortshift_stereo/averaging/frame_average.hpp"
#include "cortshift_stereo/rectification/rectifier.hpp"

namespace cortshift_stereo {

/// One reconstructed pair and where it was taken.
struct PosedFrame {
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_pmr_left = Eigen::Isometry3d::Identity();
  std::shared_ptr<const Rectifier> rectifier;  ///< another one means another calibration or setting
  Frame frame;
  std::vector<std::string> warnings;  ///< what a person should know before believing it
};

/// What two pairs of one view may differ by.
struct ViewTolerance {
  double translation = 0.0005;  ///< of the camera [m]
  double rotation = 0.002;      ///< [rad]
  double age = 3.0;             ///< time between the two [s]
};

/// The newest frames that agree with the newest one in calibration, setting and pose.
class ViewFrames {
 public:
  /// @param capacity  frames kept, at least 1
  ViewFrames(const ViewTolerance& tolerance, std::size_t capacity) : tolerance_(tolerance), capacity_(capacity) {}

  /// Frames of another view, or from a later time (a recording that runs again), are forgotten.
  void add(const PosedFrame& newest);

  std::size_t size() const { return frames_.size(); }
  std::size_t capacity() const { return capacity_; }

  struct Mean {
    ReconstructionResult result;  ///< as averageFrames() gives it
    Eigen::Isometry3d T_pmr_left;
    std::vector<std::string> warnings;  ///< of any of the frames
  };
  /// Per-pixel mean of the frames and mean of their poses: the tracker's noise averages out as well. At least one
  /// frame.
  Mean mean() const;

 private:
  bool agree(const PosedFrame& earlier, const PosedFrame& newest) const;

  ViewTolerance tolerance_;
  std::size_t capacity_;
  std::vector<PosedFrame> frames_;
};

}  // namespace cortshift_stereo
