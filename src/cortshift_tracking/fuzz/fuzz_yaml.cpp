// Files of calibration and settings, poses as a table, excluded regions, and what a case keeps. The first byte says
// which.
#include <filesystem>
#include <fstream>

#include "bytes_as_file.hpp"
#include "cortshift_flow/flow.hpp"
#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/calibration/hand_eye/hand_eye_yaml.hpp"
#include "cortshift_stereo/calibration/hand_eye/pose_table.hpp"
#include "cortshift_stereo/calibration/settings/settings_manifest.hpp"
#include "cortshift_stereo/calibration/settings/settings_warp.hpp"
#include "cortshift_tracking/field/exclusion.hpp"

namespace {

void read(int which, const std::string& path) {
  switch (which) {
    case 0:
      cortshift_stereo::readCameraInfoYaml(path);
      break;
    case 1:
      cortshift_stereo::readHandEyeYaml(path);
      break;
    case 2:
      cortshift_stereo::readHandEyeDeviation(path);
      break;
    case 3:
      cortshift_stereo::readPoseTable(path);
      break;
    case 4:
      cortshift_stereo::readSettingsManifest(path);
      break;
    case 5:
      cortshift_stereo::readSettingsWarp(path);
      break;
    case 6:
      cortshift_tracking::readRegions(path);
      break;
    default:
      cortshift_flow::readSettings(path);
      break;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) return 0;
  // A file on disk, as these readers want a regular one.
  static const std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("cortshift_fuzz_yaml_" + std::to_string(::getpid()));
  {
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(data + 1), static_cast<std::streamsize>(size - 1));
  }
  try {
    read(data[0] % 8, path.string());
  } catch (const std::runtime_error&) {     // each reader has its own kind, and its message
  } catch (const std::invalid_argument&) {  // that of the flow's settings
  }
  return 0;
}
