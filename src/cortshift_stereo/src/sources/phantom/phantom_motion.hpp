// What moves in a phantom case as time goes by: the stage, the microscope and the probe.
#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <string>

#include "cortshift_stereo/sources/stereo_source.hpp"
#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace cortshift_stereo {

struct PhantomMotionSettings {
  double move_time = 1.0;     ///< the microscope takes this long from one stage's place to the next [s]
  double probe_dwell = 3.0;   ///< the probe rests on each of its targets this long [s]
  double probe_travel = 1.0;  ///< and takes this long to the next one [s]
};

/// Exact poses as functions of time. The microscope stands still except while it moves between two stages.
class PhantomMotion {
 public:
  PhantomMotion(std::shared_ptr<const cortshift_stereo_phantom::PhantomScene> scene,
                const PhantomMotionSettings& settings, int stage, Stamp start);

  /// Starts the way to a stage; the time at which the microscope stands there.
  Stamp moveTo(int stage, Stamp start);

  /// Stage at a time; that of the destination from the start of the move.
  int stage() const { return to_; }

  /// Whether nothing moves from `begin` to `end`.
  bool isStill(Stamp begin, Stamp end) const { return end <= start_ || begin >= arrival_; }
  Stamp arrival() const { return arrival_; }

  Eigen::Isometry3d T_reference_microscope(Stamp time) const;

  /// Pose of the tip, z from the handle to the tip; nothing while the microscope moves or where the stage has no probe.
  std::optional<Eigen::Isometry3d> T_reference_probe_tip(Stamp time) const;

  /// Label of the target that the probe rests on; empty on its way.
  std::string probeTarget(Stamp time) const;

 private:
  struct ProbePhase {
    std::size_t index = 0;  // target that it rests on or leaves
    double travelled = 0;   // 0...1 on the way to the next one
  };
  std::optional<ProbePhase> probePhase(Stamp time) const;
  Eigen::Isometry3d T_pmr_probe(std::size_t target) const;

  std::shared_ptr<const cortshift_stereo_phantom::PhantomScene> scene_;
  PhantomMotionSettings settings_;
  int from_, to_;
  Stamp start_, arrival_;
};

}  // namespace cortshift_stereo
