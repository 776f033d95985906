#include "cortshift_stereo/calibration/settings/settings_manifest.hpp"

#include <filesystem>
#include <set>

#include "calibration/yaml_file.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kLargestMagnification = 100;
constexpr double kLongestFocalLength = 2;  // [m]

void refuseUnknownKeys(const YAML::Node& node, const std::set<std::string>& known, const std::string& place) {
  if (!node.IsMap()) throw CalibrationError(place + ": holds no keys and values; write it anew");
  for (const auto& entry : node) {
    const auto key = entry.first.as<std::string>();
    if (!known.count(key)) {
      std::string list;
      for (const auto& name : known) list += " " + name;
      throw CalibrationError(place + ": unknown key " + key + "; known are" + list);
    }
  }
}

double numberWithin(const YAML::Node& node, const std::string& key, double highest, const std::string& place) {
  const double value = requiredNumber(node, key, place);
  if (!(value > 0 && value <= highest))
    throw CalibrationError(place + ": " + key + " is " + exactText(value) + "; allowed is (0, " + exactText(highest) +
                           "]" + (key == "focal_length" ? " m (metres, not millimetres)" : ""));
  return value;
}

MicroscopeSetting readSetting(const YAML::Node& node, const std::string& place) {
  return {numberWithin(node, "magnification", kLargestMagnification, place),
          numberWithin(node, "focal_length", kLongestFocalLength, place)};
}

YAML::Node requiredList(const YAML::Node& node, const std::string& key, const std::string& place) {
  const YAML::Node list = requiredNode(node, key, place);
  if (!list.IsSequence() || list.size() == 0)
    throw CalibrationError(place + ": " + key + " is not a list with entries; list at least one");
  return list;
}

ManifestBoard readBoard(const YAML::Node& node, const std::filesystem::path& folder, const std::string& place) {
  refuseUnknownKeys(node, {"board", "reference", "views"}, place);
  const auto path = [&](const YAML::Node& pair, const std::string& side, const std::string& where) {
    return (folder / requiredValue<std::string>(pair, side, where)).string();
  };
  ManifestBoard board;
  try {
    board.board.corners = Board::parseCorners(requiredValue<std::string>(node, "board", place));
  } catch (const CalibrationError& fault) {
    throw CalibrationError(place + ": " + fault.what());
  }
  const YAML::Node reference = requiredNode(node, "reference", place);
  refuseUnknownKeys(reference, {"left", "right"}, place + ".reference");
  board.left = path(reference, "left", place + ".reference");
  board.right = path(reference, "right", place + ".reference");
  const YAML::Node views = requiredList(node, "views", place);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::string where = place + ".views[" + std::to_string(i) + "]";
    refuseUnknownKeys(views[i], {"magnification", "focal_length", "left", "right"}, where);
    board.views.push_back(
        {readSetting(views[i], where), path(views[i], "left", where), path(views[i], "right", where)});
  }
  return board;
}

}  // namespace

SettingsManifest readSettingsManifest(const std::string& path) {
  const YAML::Node root = loadYamlFile(path);
  refuseUnknownKeys(root, {"reference", "boards"}, path);
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  SettingsManifest manifest;
  const YAML::Node reference = requiredNode(root, "reference", path);
  refuseUnknownKeys(reference, {"magnification", "focal_length"}, path + ": reference");
  manifest.reference = readSetting(reference, path + ": reference");
  const YAML::Node boards = requiredList(root, "boards", path);
  for (std::size_t i = 0; i < boards.size(); ++i)
    manifest.boards.push_back(readBoard(boards[i], folder, path + ": boards[" + std::to_string(i) + "]"));
  return manifest;
}

}  // namespace cortshift_stereo
