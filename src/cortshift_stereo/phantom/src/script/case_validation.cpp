// The ranges that the values of a phantom case may have.
#include <cmath>
#include <set>
#include <utility>

#include "cortshift_flow/range.hpp"
#include "cortshift_flow/text.hpp"
#include "cortshift_stereo/geometry/lens.hpp"
#include "cortshift_stereo_phantom/phantom_case.hpp"

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
  if (!head.picture) return;
  check("head.picture.width", head.picture->width, 0.005, 0.5);
  check("head.picture.centre", head.picture->centre, -0.2, 0.2);
  check("head.picture.turn", head.picture->turn, -6.3, 6.3);
  check("head.picture.gain", head.picture->gain, 0.05, 20);
  check("head.picture.contrast", head.picture->contrast, 0, 5);
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
  check("image.shot_noise", image.shot_noise, 0, 0.2);
  check("image.depth_of_field", image.depth_of_field, 0, 2);
  check("image.focus_offset", image.focus_offset, -0.05, 0.05);
  check("image.jpeg", image.jpeg, 0, 100);
  for (const auto& [side, response] : {std::pair("left", image.left), std::pair("right", image.right)}) {
    const std::string key = std::string("image.") + side;
    check(key + ".white_balance", response.white_balance, 0.1, 5);
    check(key + ".gain", response.gain, 0.1, 5);
    check(key + ".black_level", response.black_level, 0, 0.3);
    check(key + ".blur", response.blur, 0, 8);
  }
  if (!light.film) return;
  check("light.film.strength", light.film->strength, 0, 100);
  check("light.film.slope", light.film->slope, 0, 0.5);
  check("light.film.wavelength", light.film->wavelength, 0.0008, 0.02);
  check("light.film.lamp_angle", light.film->lamp_angle, 0.001, 1);
}

void checkMotion(const MotionSettings& motion) {
  check("motion.pulsation", motion.pulsation, 0, 0.003);
  check("motion.pulsation_rate", motion.pulsation_rate, 0.1, 5);
  check("motion.breathing", motion.breathing, 0, 0.003);
  check("motion.breathing_rate", motion.breathing_rate, 0.05, 2);
  check("motion.pair_interval", motion.pair_interval, 0.001, 10);
}

void checkStage(const std::string& key, const StageSettings& stage) {
  const DeformationSettings& d = stage.deformation;
  check(key + ".deformation.sag", d.sag, -0.03, 0.03);
  check(key + ".deformation.lateral", d.lateral, -0.02, 0.02);
  check(key + ".deformation.bulge", d.bulge, -0.03, 0.03);
  check(key + ".deformation.bulge_centre", d.bulge_centre, -0.06, 0.06);
  check(key + ".deformation.bulge_width", d.bulge_width, 0.002, 0.1);
  check(key + ".deformation.variation", d.variation, 0, 0.005);
  check(key + ".deformation.outward", d.outward, -0.01, 0.01);
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
  check(key + ".drape", stage.drape, -0.02, 0.02);
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
  for (const RodSettings& rod : stage.rods) {
    check(key + ".rods.tip", rod.tip, -0.06, 0.06);
    check(key + ".rods.heading", rod.heading, -6.3, 6.3);
    check(key + ".rods.slope", rod.slope, -0.2, 1.5);
    check(key + ".rods.diameter", rod.diameter, 0.0005, 0.02);
    check(key + ".rods.length", rod.length, rod.diameter, 0.3);
  }
  for (const ProbeTargetSettings& target : stage.probe) {
    if (target.label.empty()) throw PhantomCaseError(key + ".probe: a target has no label");
    check(key + ".probe.at", target.at, -0.06, 0.06);
    check(key + ".probe.lift", target.lift, 0, 0.5);
  }
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
  checkMotion(motion);
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

}  // namespace cortshift_stereo_phantom
