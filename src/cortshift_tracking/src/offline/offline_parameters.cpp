#include "cortshift_tracking/offline/offline_parameters.hpp"

#include <ros/package.h>

#include <opencv2/core/utility.hpp>

#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {

namespace fs = std::filesystem;
using cortshift_stereo::ParameterSource;

OfflineParameters OfflineParameters::load(const fs::path& folder) {
  return {cortshift_stereo::SurfaceReconstructionParameters::load(
              ParameterSource::fromYaml((folder / "surface_reconstruction.yaml").string())),
          ShiftTrackerParameters::load(ParameterSource::fromYaml((folder / "shift_tracker.yaml").string()))};
}

void OfflineParameters::setThreads(int threads) {
  tracker.shift.setThreads(threads);
  cv::setNumThreads(threads > 0 ? threads : -1);
}

fs::path shippedConfiguration() {
  const std::string package = ros::package::getPath("cortshift_tracking");
  fs::path folder = fs::path(package) / "config";  // of an install space
  if (!fs::is_directory(folder)) folder = fs::path(package).parent_path().parent_path() / "config";
  if (package.empty() || !fs::is_directory(folder))
    throw TrackingError("the workspace's config folder is not found; source the workspace or say --config FOLDER");
  return folder;
}

}  // namespace cortshift_tracking
