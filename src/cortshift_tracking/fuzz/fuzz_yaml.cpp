// Files of calibration and settings, poses as a table, and excluded regions. The first byte says which.
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "cortshift_flow/flow.hpp"
#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/calibration/hand_eye/hand_eye_yaml.hpp"
#include "cortshift_stereo/calibration/hand_eye/pose_table.hpp"
#include "cortshift_stereo/calibration/settings/settings_manifest.hpp"
#include "cortshift_stereo/calibration/settings/settings_report.hpp"
#include "cortshift_stereo/calibration/settings/settings_warp.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"
#include "cortshift_tracking/field/exclusion.hpp"

namespace {

using Read = void (*)(const std::string&);

constexpr Read kReaders[] = {
    [](const std::string& path) { cortshift_stereo::readCameraInfoYaml(path); },
    [](const std::string& path) { cortshift_stereo::readHandEyeYaml(path); },
    [](const std::string& path) { cortshift_stereo::readHandEyeDeviation(path); },
    [](const std::string& path) { cortshift_stereo::readPoseTable(path); },
    [](const std::string& path) { cortshift_stereo::readSettingsManifest(path); },
    [](const std::string& path) { cortshift_stereo::readSettingsWarp(path); },
    [](const std::string& path) { cortshift_tracking::readRegions(path); },
    [](const std::string& path) { cortshift_flow::readSettings(path); },
    [](const std::string& path) { cortshift_stereo::readStereoResiduals(path); },
    [](const std::string& path) { cortshift_stereo::readSettingsResiduals(path); },
};

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
    kReaders[data[0] % std::size(kReaders)](path.string());
  } catch (const std::runtime_error&) {     // each reader has its own kind, and its message
  } catch (const std::invalid_argument&) {  // that of the flow's settings
  }
  return 0;
}
