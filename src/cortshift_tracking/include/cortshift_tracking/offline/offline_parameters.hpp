// The parameters of the nodes for programs without a master.
#pragma once

#include <filesystem>

#include "cortshift_stereo/ros/reconstruction/surface_reconstruction_parameters.hpp"
#include "cortshift_tracking/ros/parameters.hpp"

namespace cortshift_tracking {

struct OfflineParameters {
  cortshift_stereo::SurfaceReconstructionParameters reconstruction;
  ShiftTrackerParameters tracker;

  /// From surface_reconstruction.yaml and shift_tracker.yaml in a folder, as the launch files load them.
  /// @throws cortshift_stereo::ParameterError naming file, key, value and what is allowed
  static OfflineParameters load(const std::filesystem::path& folder);

  /// All that are in force, as a stage keeps them.
  std::string configuration() const { return tracker.configuration(reconstruction.effective()); }

  /// For everything that computes, in place of what the configuration says; 0: one for each core.
  void setThreads(int threads);
};

/// The folder that the launch files take their parameters from.
/// @throws TrackingError if this program does not run from a workspace
std::filesystem::path shippedConfiguration();

}  // namespace cortshift_tracking
