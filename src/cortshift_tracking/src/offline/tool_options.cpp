#include "cortshift_tracking/offline/tool_options.hpp"

#include <cmath>
#include <cstdio>

#include "cortshift_stereo/provenance.hpp"
#include "cortshift_stereo/ros/static_transforms.hpp"
#include "cortshift_tracking/offline/case_plan.hpp"

namespace cortshift_tracking {

using cortshift_stereo::Options;
using cortshift_stereo::UsageError;

OfflineParameters parametersFrom(const Options& options) {
  const double threads = options.number("threads", -1);
  if (options.find("threads") && !(threads >= 0 && threads <= 64 && threads == std::floor(threads)))
    throw UsageError("--threads must be a whole number from 0 to 64");
  const auto config = options.find("config");
  OfflineParameters parameters = OfflineParameters::load(config ? *config : shippedConfiguration().string());
  if (const auto folder = options.find("settings-calibration"))
    parameters.reconstruction.settings_calibration = *folder;
  if (threads >= 0) parameters.setThreads(static_cast<int>(threads));
  parameters.tracker.shift.configuration = cortshift_stereo::sha256(parameters.configuration());
  return parameters;
}

std::optional<Eigen::Vector3d> gravityFrom(const Options& options) {
  const auto gravity = options.find("gravity");
  if (!gravity) return std::nullopt;
  try {
    return directionFromText(*gravity);
  } catch (const PlanError& error) {
    throw UsageError("--gravity: " + std::string(error.what()));
  }
}

void printWarnings(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) std::printf("  WARNING: %s\n", warning.c_str());
  std::fflush(stdout);
}

std::unique_ptr<CaseRecording> recordingFrom(const Options& options, const OfflineParameters& parameters) {
  const auto static_tf = options.find("static-tf");
  return std::make_unique<CaseRecording>(
      options.required("CASE.bag"), parameters.reconstruction,
      static_tf ? cortshift_stereo::readStaticTransforms(*static_tf) : std::vector<geometry_msgs::TransformStamped>());
}

}  // namespace cortshift_tracking
