#include "cortshift_stereo/calibration/settings_manifest.hpp"

#include <cmath>
#include <filesystem>
#include <set>
#include <sstream>

#include "yaml_file.hpp"

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

/// Reads images and sees to it that they are of one size.
class ImageReader {
 public:
  cv::Mat read(const std::string& path) {
    cv::Mat image = readGreyImage(path);
    if (first_.empty()) {
      first_ = path;
      size_ = image.size();
    }
    if (image.size() != size_) {
      std::ostringstream message;
      message << path << " is " << image.cols << "x" << image.rows << " but " << first_ << " is " << size_.width << "x"
              << size_.height << "; all images must come from the same cameras at one size";
      throw CalibrationError(message.str());
    }
    return image;
  }
  cv::Size size() const { return size_; }

 private:
  std::string first_;
  cv::Size size_;
};

Corners requireBoard(ImageReader& images, const std::string& path, const Board& board) {
  const auto corners = findBoard(images.read(path), board);
  if (!corners)
    throw CalibrationError(path + ": the whole " + board.name() +
                           " board is not seen at the reference setting; correct the board or take the pair again");
  return *corners;
}

std::string fixed(double value) {
  std::ostringstream text;
  text.precision(4);
  text << std::fixed << value;
  return text.str();
}

std::string sideText(const std::string& side, const SettingsCalibration& calibration) {
  std::string text = side + ":\n  degree_in_image: " + std::to_string(calibration.image_degree) +
                     "\n  degree_in_magnification: " + std::to_string(calibration.setting_degrees.first) +
                     "\n  degree_in_focal_length: " + std::to_string(calibration.setting_degrees.second) +
                     "\n  rms_px: " + fixed(calibration.rms) +
                     "\n  held_out_rms_px: " + fixed(calibration.held_out_rms) + "\n  views:\n";
  for (const auto& view : calibration.residuals)
    text += "    - {image: " + YAML::Dump(YAML::Node(view.name)) +
            ", magnification: " + exactText(view.setting.magnification) +
            ", focal_length: " + exactText(view.setting.focal_length) + ", rms_px: " + fixed(view.rms) +
            ", held_out_px: " + (std::isnan(view.held_out) ? ".nan" : fixed(view.held_out)) + "}\n";
  return text;
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

SettingViews findSettingViews(const SettingsManifest& manifest, const std::function<void(double)>& progress) {
  SettingViews found;
  ImageReader images;
  std::size_t total = 0, done = 0;
  for (const auto& board : manifest.boards) total += board.views.size();
  for (const auto& board : manifest.boards) {
    const Corners left_reference = requireBoard(images, board.left, board.board);
    const Corners right_reference = requireBoard(images, board.right, board.board);
    const auto add = [&](const std::string& path, const MicroscopeSetting& setting, const Corners& reference,
                         std::vector<SettingView>& views) {
      auto corners = findBoard(images.read(path), board.board);
      if (!corners) {
        found.rejected.push_back({path, "the whole " + board.board.name() + " board is not seen"});
        return;
      }
      // Nothing turns between settings, so the board's first row ends where it ended at the reference.
      if ((corners->back() - corners->front()).dot(reference.back() - reference.front()) < 0)
        corners = upsideDown(*corners);
      views.push_back({path, setting, *corners, reference});
    };
    for (const auto& view : board.views) {
      add(view.left, view.setting, left_reference, found.left);
      add(view.right, view.setting, right_reference, found.right);
      if (progress) progress(static_cast<double>(++done) / static_cast<double>(total));
    }
  }
  found.size = images.size();
  return found;
}

void writeSettingsCalibration(const std::string& folder, const std::string& date, const SettingsCalibration& left,
                              const SettingsCalibration& right, const std::vector<RejectedView>& rejected) {
  std::error_code fault;
  std::filesystem::create_directories(folder, fault);
  if (fault) throw CalibrationError(folder + ": cannot be made (" + fault.message() + "); give another folder");
  const std::filesystem::path place(folder);
  const auto remarks = [&](const std::string& side, const SettingsCalibration& calibration) {
    return "Deformation field of the " + side + " camera, " + date + ", from " +
           std::to_string(calibration.residuals.size()) + " views: RMS " + fixed(calibration.rms) +
           " px, on held-out settings " + fixed(calibration.held_out_rms) +
           " px.\nRight in the plane of the board; elsewhere too if the entrance pupil does not move with the "
           "settings.";
  };
  writeSettingsWarp((place / "settings_left.yaml").string(), left.warp, remarks("left", left));
  writeSettingsWarp((place / "settings_right.yaml").string(), right.warp, remarks("right", right));
  std::string text =
      "# Deformation fields from any setting to the reference. rms_px is in the view's own image,\n"
      "# held_out_px in pixels of the reference image, fitted without that setting (.nan where the\n"
      "# setting is a corner of the calibrated range, which no others surround).\n"
      "date: " +
      date + "\nreference: {magnification: " + exactText(left.warp.model().reference.magnification) +
      ", focal_length: " + exactText(left.warp.model().reference.focal_length) + "}\n" + sideText("left", left) +
      sideText("right", right);
  std::vector<RejectedView> all = rejected;
  all.insert(all.end(), left.rejected.begin(), left.rejected.end());
  all.insert(all.end(), right.rejected.begin(), right.rejected.end());
  text += std::string("rejected:") + (all.empty() ? " []" : "") + "\n";
  for (const auto& view : all)
    text += "  - {image: " + YAML::Dump(YAML::Node(view.name)) + ", reason: \"" + view.reason + "\"}\n";
  writeTextFile((place / "settings_report.yaml").string(), text);
}

}  // namespace cortshift_stereo
