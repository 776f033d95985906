// Options that the offline tools share.
#pragma once

#include <Eigen/Core>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_stereo/command_line.hpp"
#include "cortshift_tracking/offline/case_recording.hpp"
#include "cortshift_tracking/offline/offline_parameters.hpp"

namespace cortshift_tracking {

/// --config FOLDER (by default the workspace's), --settings-calibration FOLDER and --threads N.
/// @throws UsageError, cortshift_stereo::ParameterError, TrackingError
OfflineParameters parametersFrom(const cortshift_stereo::Options& options);

/// --gravity X,Y,Z. @throws UsageError
std::optional<Eigen::Vector3d> gravityFrom(const cortshift_stereo::Options& options);

/// The bag named by the word CASE.bag, with --static-tf FILE. @throws TrackingError
std::unique_ptr<CaseRecording> recordingFrom(const cortshift_stereo::Options& options,
                                             const OfflineParameters& parameters);

/// Each on a line of its own.
void printWarnings(const std::vector<std::string>& warnings);

class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count(); }

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

}  // namespace cortshift_tracking
