#include "cortshift_stereo_phantom/phantom_case.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "cortshift_stereo/geometry/lens.hpp"
#include "script/strict_yaml.hpp"

namespace cortshift_stereo_phantom {
namespace {

/// translation [m] and rpy [rad] (fixed axes: roll about x, then pitch about y, then yaw about z).
void readPose(StrictMap& map, Eigen::Isometry3d& pose) {
  Eigen::Vector3d translation, rpy;
  map.require("translation", translation);
  map.require("rpy", rpy);
  pose = Eigen::Translation3d(translation) * Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) * Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX());
}

void readOutline(StrictMap& map, OutlineSettings& outline) {
  map.get("centre", outline.centre);
  map.get("radii", outline.radii);
  map.get("irregularity", outline.irregularity);
  map.get("seed", outline.seed);
}

void readHead(StrictMap& map, HeadSettings& head) {
  map.get("seed", head.seed);
  map.get("dome_radius", head.dome_radius);
  map.get("sulcus_depth", head.sulcus_depth);
  map.get("vein_diameter", head.vein_diameter);
  map.section("craniotomy", [&](StrictMap& m) { readOutline(m, head.craniotomy); });
  map.get("window_width", head.window_width);
  map.get("bone_height", head.bone_height);
  map.get("bevel_width", head.bevel_width);
  map.section("picture", [&](StrictMap& m) {
    PictureSettings& picture = head.picture.emplace();
    m.require("file", picture.file);
    m.get("width", picture.width);
    m.get("centre", picture.centre);
    m.get("turn", picture.turn);
    m.get("gain", picture.gain);
    m.get("contrast", picture.contrast);
  });
}

void readCameras(StrictMap& map, CameraSettings& cameras) {
  Eigen::Vector2d size(cameras.size.width, cameras.size.height);
  map.get("size", size);
  cameras.size = {static_cast<int>(size.x()), static_cast<int>(size.y())};
  map.get("working_distance", cameras.working_distance);
  map.get("field_of_view", cameras.field_of_view);
  map.get("baseline", cameras.baseline);
  std::string lens = cortshift_stereo::nameOf(cameras.lens);
  map.get("lens", lens);
  try {
    cameras.lens = cortshift_stereo::lensNamed(lens, map.path() + ".lens");
  } catch (const cortshift_stereo::CalibrationError& error) {
    throw PhantomCaseError(error.what());
  }
  map.get("left_distortion", cameras.left_distortion);
  map.get("right_distortion", cameras.right_distortion);
  map.get("left_principal_offset", cameras.left_principal_offset);
  map.get("right_principal_offset", cameras.right_principal_offset);
  map.get("right_focal_ratio", cameras.right_focal_ratio);
  map.get("right_misalignment", cameras.right_misalignment);
  map.section("zoom", [&](StrictMap& m) {
    ZoomSettings& zoom = cameras.zoom.emplace();
    m.get("magnification", zoom.magnification);
    m.get("focal_length", zoom.focal_length);
    m.get("focal_power", zoom.focal_power);
    m.get("breathing", zoom.breathing);
    m.get("drift_zoom", zoom.drift_zoom);
    m.get("drift_focus", zoom.drift_focus);
    m.get("distortion", zoom.distortion);
    m.get("pupil_travel", zoom.pupil_travel);
  });
}

void readLight(StrictMap& map, LightSettings& light) {
  map.get("position_head", light.position_head);
  map.get("ambient", light.ambient);
  map.get("diffuse", light.diffuse);
  map.get("specular", light.specular);
  map.get("shininess", light.shininess);
  map.section("film", [&](StrictMap& m) {
    FilmSettings& film = light.film.emplace();
    m.get("strength", film.strength);
    m.get("slope", film.slope);
    m.get("wavelength", film.wavelength);
    m.get("lamp_angle", film.lamp_angle);
    m.get("seed", film.seed);
  });
}

void readResponse(StrictMap& map, ResponseSettings& response) {
  map.get("white_balance", response.white_balance);
  map.get("gain", response.gain);
  map.get("black_level", response.black_level);
  map.get("blur", response.blur);
}

void readImage(StrictMap& map, ImageSettings& image) {
  map.get("supersampling", image.supersampling);
  map.get("noise", image.noise);
  map.get("vignette", image.vignette);
  map.get("right_gain", image.right_gain);
  map.get("noise_seed", image.noise_seed);
  map.get("shot_noise", image.shot_noise);
  map.get("depth_of_field", image.depth_of_field);
  map.get("focus_offset", image.focus_offset);
  map.get("bayer", image.bayer);
  map.get("jpeg", image.jpeg);
  map.section("left", [&](StrictMap& m) { readResponse(m, image.left); });
  map.section("right", [&](StrictMap& m) { readResponse(m, image.right); });
}

void readMotion(StrictMap& map, MotionSettings& motion) {
  map.get("pulsation", motion.pulsation);
  map.get("pulsation_rate", motion.pulsation_rate);
  map.get("breathing", motion.breathing);
  map.get("breathing_rate", motion.breathing_rate);
  map.get("pair_interval", motion.pair_interval);
}

StageSettings readStage(StrictMap& map) {
  StageSettings stage;
  map.require("name", stage.name);
  map.section("deformation", [&](StrictMap& m) {
    DeformationSettings& d = stage.deformation;
    m.get("sag", d.sag);
    m.get("lateral", d.lateral);
    m.get("bulge", d.bulge);
    m.get("bulge_centre", d.bulge_centre);
    m.get("bulge_width", d.bulge_width);
    m.get("variation", d.variation);
    m.get("outward", d.outward);
  });
  map.section("microscope", [&](StrictMap& m) {
    m.get("target", stage.microscope.target);
    m.get("distance", stage.microscope.distance);
    m.get("tilt", stage.microscope.tilt);
    m.get("roll", stage.microscope.roll);
  });
  map.get("gain", stage.gain);
  map.get("magnification", stage.magnification);
  map.get("focal_length", stage.focal_length);
  map.list("blood", [&](StrictMap& m) {
    BloodSettings blood;
    readOutline(m, blood.outline);
    m.get("border", blood.border);
    m.get("cotton", blood.cotton);
    stage.blood.push_back(blood);
  });
  map.get("drape", stage.drape);
  map.section("hole", [&](StrictMap& m) {
    stage.hole.emplace();
    readOutline(m, stage.hole->outline);
    m.get("depth", stage.hole->depth);
    m.get("wall", stage.hole->wall);
  });
  map.section("retractor", [&](StrictMap& m) {
    stage.retractor.emplace();
    m.get("tip", stage.retractor->tip);
    m.get("heading", stage.retractor->heading);
    m.get("slope", stage.retractor->slope);
    m.get("width", stage.retractor->width);
    m.get("length", stage.retractor->length);
  });
  map.list("rods", [&](StrictMap& m) {
    RodSettings rod;
    m.get("tip", rod.tip);
    m.get("heading", rod.heading);
    m.get("slope", rod.slope);
    m.get("diameter", rod.diameter);
    m.get("length", rod.length);
    stage.rods.push_back(rod);
  });
  map.list("probe", [&](StrictMap& m) {
    ProbeTargetSettings target;
    m.require("label", target.label);
    m.require("at", target.at);
    m.get("lift", target.lift);
    stage.probe.push_back(target);
  });
  return stage;
}

}  // namespace

double MotionSettings::outwardAt(std::uint64_t frame) const {
  constexpr double kTurn = 6.283185307179586, kState = 20e-6;  // [m]
  const double time = pair_interval * static_cast<double>(frame);
  const double outward =
      pulsation * std::sin(kTurn * pulsation_rate * time) + breathing * std::sin(kTurn * breathing_rate * time);
  return kState * std::round(outward / kState);
}

PhantomCase PhantomCase::atPair(std::uint64_t frame) const {
  PhantomCase now = *this;
  for (StageSettings& stage : now.stages) stage.deformation.outward += motion.outwardAt(frame);
  return now;
}

namespace {

PhantomCase parseCase(const YAML::Node& root, const std::string& origin) {
  PhantomCase result;
  try {
    StrictMap map(root, "");
    map.require("name", result.name);
    map.section("brain_in_pmr", [&](StrictMap& m) { readPose(m, result.T_pmr_brain); });
    map.section("reference_in_pmr", [&](StrictMap& m) { readPose(m, result.T_pmr_reference); });
    map.section("head_in_microscope", [&](StrictMap& m) { readPose(m, result.T_microscope_head); });
    map.get("gravity_in_pmr", result.gravity_pmr);
    if (result.gravity_pmr.norm() > 1e-6) result.gravity_pmr.normalize();
    map.section("head", [&](StrictMap& m) { readHead(m, result.head); });
    map.section("cameras", [&](StrictMap& m) { readCameras(m, result.cameras); });
    map.section("light", [&](StrictMap& m) { readLight(m, result.light); });
    map.section("image", [&](StrictMap& m) { readImage(m, result.image); });
    map.section("motion", [&](StrictMap& m) { readMotion(m, result.motion); });
    map.list("stages", [&](StrictMap& m) { result.stages.push_back(readStage(m)); });
    map.finish();
    result.validate();
  } catch (const PhantomCaseError& error) {
    throw PhantomCaseError("phantom case " + origin + ": " + error.what());
  }
  return result;
}

YAML::Node parseYaml(const std::string& yaml, const std::string& origin) {
  try {
    return YAML::Load(yaml);
  } catch (const YAML::Exception& error) {
    throw PhantomCaseError("phantom case " + origin + ": not YAML: " + error.what());
  }
}

/// Mappings key by key; everything else as `changes` has it.
YAML::Node merged(const YAML::Node& base, const YAML::Node& changes) {
  if (!base.IsMap() || !changes.IsMap()) return YAML::Clone(changes);
  YAML::Node out = YAML::Clone(base);
  for (const auto& entry : changes) {
    const auto key = entry.first.as<std::string>();
    out[key] = base[key] ? merged(base[key], entry.second) : YAML::Clone(entry.second);
  }
  return out;
}

/// The file over the one that its key `based_on` names.
YAML::Node loadYaml(const std::filesystem::path& path, int depth) {
  constexpr int kDeepest = 8;
  if (depth > kDeepest) throw PhantomCaseError("phantom case " + path.string() + ": based_on goes round in a circle");
  std::ifstream file(path);
  if (!file) throw PhantomCaseError("phantom case " + path.string() + " cannot be read; set the path of a case file");
  std::ostringstream content;
  content << file.rdbuf();
  YAML::Node root = parseYaml(content.str(), path.string());
  if (root.IsMap() && root["head"] && root["head"].IsMap() && root["head"]["picture"] &&
      root["head"]["picture"].IsMap() && root["head"]["picture"]["file"]) {
    YAML::Node picture = root["head"]["picture"]["file"];
    picture = (path.parent_path() / picture.as<std::string>()).string();
  }
  if (!root.IsMap() || !root["based_on"]) return root;
  if (!root["based_on"].IsScalar())
    throw PhantomCaseError("phantom case " + path.string() + ": based_on must name a file");
  const auto base = path.parent_path() / root["based_on"].as<std::string>();
  root.remove("based_on");
  return merged(loadYaml(base, depth + 1), root);
}

}  // namespace

PhantomCase parsePhantomCase(const std::string& yaml, const std::string& origin) {
  return parseCase(parseYaml(yaml, origin), origin);
}

PhantomCase loadPhantomCase(const std::string& path) { return parseCase(loadYaml(path, 0), path); }

}  // namespace cortshift_stereo_phantom
