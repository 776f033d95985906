#include "cortshift_stereo_phantom/phantom_case.hpp"

#include <cmath>
#include <fstream>
#include <set>
#include <sstream>

#include "cortshift_flow/range.hpp"
#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/geometry/lens.hpp"
#include "strict_yaml.hpp"

namespace cortshift_stereo_phantom {
namespace {

void check(const std::string& key, double value, double low, double high) {
  cortshift_flow::requireRange<PhantomCaseError>(key, value, low, high);
}

void check(const std::string& key, const Eigen::VectorXd& values, double low, double high) {
  for (Eigen::Index i = 0; i < values.size(); ++i) check(key + "[" + std::to_string(i) + "]", values[i], low, high);
}

void checkOutline(const std::string& key, const OutlineSettings& outline, double smallest, double largest) {
  check(key + ".centre", outline.centre, -0.06, 0.06);
  check(key + ".radii", outline.radii, smallest, largest);
  check(key + ".irregularity", outline.irregularity, 0, 0.4);
}

void checkHead(const HeadSettings& head) {
  check("head.dome_radius", head.dome_radius, 0.03, 1.0);
  check("head.sulcus_depth", head.sulcus_depth, 0, 0.004);
  check("head.vein_diameter", head.vein_diameter, 0.0004, 0.004);
  checkOutline("head.craniotomy", head.craniotomy, 0.005, 0.06);
  check("head.window_width", head.window_width, 0.001, 0.95 * head.craniotomy.radii.minCoeff());
  check("head.bone_height", head.bone_height, 0, 0.01);
  check("head.bevel_width", head.bevel_width, 0.0005, 0.02);
}

void checkDistortion(const std::string& key, cortshift_stereo::LensModel lens, const std::vector<double>& values) {
  check(key, Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size())), -2, 2);
  try {
    cortshift_stereo::checkedCoefficients(lens, values, key);
  } catch (const cortshift_stereo::CalibrationError& error) {
    throw PhantomCaseError(error.what());
  }
}

void checkCameras(const CameraSettings& cameras) {
  check("cameras.size[0]", cameras.size.width, 64, 8192);
  check("cameras.size[1]", cameras.size.height, 48, 8192);
  check("cameras.working_distance", cameras.working_distance, 0.1, 1.0);
  check("cameras.field_of_view", cameras.field_of_view, 0.01, 0.3);
  check("cameras.baseline", cameras.baseline, 0.005, 0.2);
  checkDistortion("cameras.left_distortion", cameras.lens, cameras.left_distortion);
  checkDistortion("cameras.right_distortion", cameras.lens, cameras.right_distortion);
  check("cameras.left_principal_offset", cameras.left_principal_offset, -200, 200);
  check("cameras.right_principal_offset", cameras.right_principal_offset, -200, 200);
  check("cameras.right_focal_ratio", cameras.right_focal_ratio, 0.9, 1.1);
  check("cameras.right_misalignment", cameras.right_misalignment, -0.1, 0.1);
  if (!cameras.zoom) return;
  const ZoomSettings& zoom = *cameras.zoom;
  check("cameras.zoom.magnification", zoom.magnification, 0.1, 50);
  check("cameras.zoom.focal_length", zoom.focal_length, 0.05, 2);
  check("cameras.zoom.focal_power", zoom.focal_power, 0, 2);
  check("cameras.zoom.breathing", zoom.breathing, -0.2, 0.2);
  check("cameras.zoom.drift_zoom", zoom.drift_zoom, -100, 100);
  check("cameras.zoom.drift_focus", zoom.drift_focus, -100, 100);
  check("cameras.zoom.distortion", zoom.distortion, -2, 2);
  check("cameras.zoom.pupil_travel", zoom.pupil_travel, -0.05, 0.05);
}

void checkLightAndImage(const LightSettings& light, const ImageSettings& image) {
  check("light.position_head", light.position_head, -1, 1);
  check("light.ambient", light.ambient, 0, 2);
  check("light.diffuse", light.diffuse, 0, 2);
  check("light.specular", light.specular, 0, 5);
  check("light.shininess", light.shininess, 1, 5000);
  check("image.supersampling", image.supersampling, 1, 8);
  check("image.noise", image.noise, 0, 0.2);
  check("image.vignette", image.vignette, 0, 0.95);
  check("image.right_gain", image.right_gain, 0.1, 5);
}

void checkStage(const std::string& key, const StageSettings& stage) {
  const DeformationSettings& d = stage.deformation;
  check(key + ".deformation.sag", d.sag, -0.03, 0.03);
  check(key + ".deformation.lateral", d.lateral, -0.02, 0.02);
  check(key + ".deformation.bulge", d.bulge, -0.03, 0.03);
  check(key + ".deformation.bulge_centre", d.bulge_centre, -0.06, 0.06);
  check(key + ".deformation.bulge_width", d.bulge_width, 0.002, 0.1);
  check(key + ".deformation.variation", d.variation, 0, 0.005);
  check(key + ".microscope.target", stage.microscope.target, -0.05, 0.05);
  check(key + ".microscope.distance", stage.microscope.distance, 0.1, 1.0);
  check(key + ".microscope.tilt", stage.microscope.tilt, -0.7, 0.7);
  check(key + ".microscope.roll", stage.microscope.roll, -3.2, 3.2);
  check(key + ".gain", stage.gain, 0, 20);
  check(key + ".magnification", stage.magnification, 0.1, 50);
  check(key + ".focal_length", stage.focal_length, 0.05, 2);
  for (const BloodSettings& blood : stage.blood) {
    checkOutline(key + ".blood", blood.outline, 0.001, 0.06);
    check(key + ".blood.border", blood.border, 0.0001, 0.01);
  }
  if (stage.hole) {
    checkOutline(key + ".hole", stage.hole->outline, 0.002, 0.04);
    check(key + ".hole.depth", stage.hole->depth, 0, 0.03);
    check(key + ".hole.wall", stage.hole->wall, 0.001, stage.hole->outline.radii.minCoeff());
  }
  if (stage.retractor) {
    check(key + ".retractor.tip", stage.retractor->tip, -0.06, 0.06);
    check(key + ".retractor.heading", stage.retractor->heading, -6.3, 6.3);
    check(key + ".retractor.slope", stage.retractor->slope, -0.2, 1.0);
    check(key + ".retractor.width", stage.retractor->width, 0.001, 0.04);
    check(key + ".retractor.length", stage.retractor->length, 0.005, 0.3);
  }
  for (const ProbeTargetSettings& target : stage.probe) {
    if (target.label.empty()) throw PhantomCaseError(key + ".probe: a target has no label");
    check(key + ".probe.at", target.at, -0.06, 0.06);
    check(key + ".probe.lift", target.lift, 0, 0.5);
  }
}

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
}

void readImage(StrictMap& map, ImageSettings& image) {
  map.get("supersampling", image.supersampling);
  map.get("noise", image.noise);
  map.get("vignette", image.vignette);
  map.get("right_gain", image.right_gain);
  map.get("noise_seed", image.noise_seed);
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
    stage.blood.push_back(blood);
  });
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

void PhantomCase::validate() const {
  const double length = gravity_pmr.norm();
  if (!(std::abs(length - 1) < 1e-9))
    throw PhantomCaseError("gravity_in_pmr has length " + cortshift_flow::shortNumber(length) +
                           "; it must be a direction");
  checkHead(head);
  checkCameras(cameras);
  checkLightAndImage(light, image);
  if (stages.empty()) throw PhantomCaseError("stages: at least one stage is needed");
  std::set<std::string> names;
  for (std::size_t i = 0; i < stages.size(); ++i) {
    const std::string key = "stages[" + std::to_string(i) + "]";
    if (stages[i].name.empty()) throw PhantomCaseError(key + ".name is empty");
    if (!names.insert(stages[i].name).second)
      throw PhantomCaseError(key + ".name = " + stages[i].name + " is taken by an earlier stage");
    checkStage(key, stages[i]);
    if (!cameras.zoom) continue;
    check(key + ".magnification", stages[i].magnification, 0.3 * cameras.zoom->magnification,
          3 * cameras.zoom->magnification);
    check(key + ".focal_length", stages[i].focal_length, 0.5 * cameras.zoom->focal_length,
          2 * cameras.zoom->focal_length);
  }
}

PhantomCase parsePhantomCase(const std::string& yaml, const std::string& origin) {
  PhantomCase result;
  try {
    YAML::Node root;
    try {
      root = YAML::Load(yaml);
    } catch (const YAML::Exception& error) {
      throw PhantomCaseError(std::string("not YAML: ") + error.what());
    }
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
    map.list("stages", [&](StrictMap& m) { result.stages.push_back(readStage(m)); });
    map.finish();
    result.validate();
  } catch (const PhantomCaseError& error) {
    throw PhantomCaseError("phantom case " + origin + ": " + error.what());
  }
  return result;
}

PhantomCase loadPhantomCase(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw PhantomCaseError("phantom case " + path + " cannot be read; set the path of a case file");
  std::ostringstream content;
  content << file.rdbuf();
  return parsePhantomCase(content.str(), path);
}

}  // namespace cortshift_stereo_phantom
