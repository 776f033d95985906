#include "cortshift_stereo_phantom/phantom_scene.hpp"

#include <cmath>
#include <limits>

#include "cortshift_flow/vectorised.hpp"
#include "imaging/rippled_film.hpp"
#include "imaging/tissue_picture.hpp"
#include "random.hpp"
#include "scene_stage.hpp"
#include "smooth_step.hpp"

namespace cortshift_stereo_phantom {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kReliefFade = 0.004;  // the gyral relief fades in over this width from the rim [m]
constexpr double kSurfaceTop = 0.040;  // the surface lies between these heights in the brain frame [m]
constexpr double kSurfaceBottom = -0.100;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// A product keeps its gradient.
ScalarField operator*(const ScalarField& a, const ScalarField& b) {
  return {a.value * b.value, a.dx * b.value + a.value * b.dx, a.dy * b.value + a.value * b.dy};
}

ScalarField operator+(const ScalarField& a, const ScalarField& b) {
  return {a.value + b.value, a.dx + b.dx, a.dy + b.dy};
}

ScalarField complement(const ScalarField& a) { return {1 - a.value, -a.dx, -a.dy}; }

/// Quintic step of (radius - start) * scale.
ScalarField stepOfRadius(const ScalarField& radius, double start, double scale) {
  const double t = (radius.value - start) * scale;
  const double slope = smoothStepSlope(t) * scale;
  return {smoothStep(t), slope * radius.dx, slope * radius.dy};
}

}  // namespace

Outline::Outline(const OutlineSettings& settings)
    : centre_(settings.centre),
      inverse_square_(settings.radii.cwiseProduct(settings.radii).cwiseInverse()),
      smallest_half_axis_(settings.radii.minCoeff()) {
  Random random(settings.seed);
  amplitude_ = 2 * settings.irregularity / static_cast<double>(waves_.size());
  for (std::size_t i = 0; i < waves_.size(); ++i) {
    const double k = kPi / settings.radii.mean() * (0.7 + 0.6 * random.uniform());
    const double heading = 2 * kPi * random.uniform();
    waves_.set(i, k * std::cos(heading), k * std::sin(heading), 2 * kPi * random.uniform());
  }
}

CORTSHIFT_VECTORISED
ScalarField Outline::radius(double x, double y) const {
  const double u = x - centre_.x(), v = y - centre_.y();
  double square = u * u * inverse_square_.x() + v * v * inverse_square_.y();
  double dx = 2 * u * inverse_square_.x(), dy = 2 * v * inverse_square_.y();
  const auto sines = waves_.sines(u, v), cosines = waves_.cosines(u, v);
  for (std::size_t i = 0; i < waves_.size(); ++i) {
    square += amplitude_ * sines[i];
    dx += amplitude_ * cosines[i] * waves_.kx()[i];
    dy += amplitude_ * cosines[i] * waves_.ky()[i];
  }
  // Every step of the radius is flat well before the middle, where the root has no derivative.
  constexpr double kMiddle = 1e-4;
  if (square < kMiddle) return {std::sqrt(kMiddle), 0, 0};
  const double root = std::sqrt(square);
  return {root, 0.5 * dx / root, 0.5 * dy / root};
}

PhantomScene::~PhantomScene() = default;
PhantomScene::PhantomScene(PhantomScene&&) noexcept = default;

PhantomScene::PhantomScene(const PhantomCase& description)
    : case_(description), head_(makeStereoHead(description.cameras)), craniotomy_(description.head.craniotomy) {
  case_.validate();
  head_.model.validate();
  T_brain_pmr_ = case_.T_pmr_brain.inverse();
  gravity_brain_ = T_brain_pmr_.linear() * case_.gravity_pmr;
  cortshift_flow_phantom::CorticalTexture::Settings settings;
  settings.seed = case_.head.seed;
  settings.sulcus_depth = case_.head.sulcus_depth;
  settings.vein_diameter = case_.head.vein_diameter;
  texture_ = std::make_shared<const cortshift_flow_phantom::CorticalTexture>(settings);
  if (case_.head.picture) picture_ = std::make_shared<const TissuePicture>(*case_.head.picture);
  if (case_.light.film) film_ = std::make_shared<const RippledFilm>(*case_.light.film);
  for (std::size_t i = 0; i < case_.stages.size(); ++i) {
    const StageSettings& from = case_.stages[i];
    Stage stage;
    stage.deformation = from.deformation;
    stage.shift = from.deformation.sag * gravity_brain_ +
                  Eigen::Vector3d(from.deformation.lateral.x(), from.deformation.lateral.y(), from.deformation.outward);
    Random random(case_.head.seed * 1000ULL + i);
    for (auto& wave : stage.variation) {
      const double k = 2 * kPi / (0.06 + 0.05 * random.uniform()), heading = 2 * kPi * random.uniform();
      wave = {k * std::cos(heading), k * std::sin(heading), 2 * kPi * random.uniform()};
    }
    if (from.hole) {
      stage.hole.emplace(from.hole->outline);
      stage.hole_settings = *from.hole;
    }
    for (const BloodSettings& blood : from.blood) stage.blood.emplace_back(blood.outline);
    stages_.push_back(stage);
    checkFolds(static_cast<int>(i));
  }
}

int PhantomScene::stageIndex(const std::string& name) const {
  std::string names;
  for (std::size_t i = 0; i < case_.stages.size(); ++i) {
    if (case_.stages[i].name == name) return static_cast<int>(i);
    names += " " + case_.stages[i].name;
  }
  throw PhantomCaseError("phantom stage " + name + " is unknown; the case " + case_.name + " has:" + names);
}

Eigen::Isometry3d PhantomScene::T_pmr_head(int stage) const {
  return case_.T_pmr_brain * placeHead(case_.stages.at(static_cast<std::size_t>(stage)).microscope);
}

StereoHead PhantomScene::headOf(int stage) const {
  const StageSettings& settings = case_.stages.at(static_cast<std::size_t>(stage));
  return atSetting(head_, case_.cameras, settings.magnification, settings.focal_length);
}

Eigen::Isometry3d PhantomScene::T_reference_microscope(int stage) const {
  return case_.T_pmr_reference.inverse() * T_pmr_head(stage) * case_.T_microscope_head.inverse();
}

SurfaceSample PhantomScene::undeformed(double x, double y) const {
  // A hyperboloid: curvature 1/R at the apex and no end to it further out.
  const double R = case_.head.dome_radius, root = std::sqrt(R * R + x * x + y * y);
  ScalarField height{R - root, -x / root, -y / root};
  const ScalarField rim = craniotomy_.radius(x, y);
  const double scale = craniotomy_.smallestHalfAxis();
  cortshift_flow_phantom::Relief relief{0, 0, 0};
  if (rim.value < 1) {
    relief = texture_->relief(x, y);
    const ScalarField fade = complement(stepOfRadius(rim, 1 - kReliefFade / scale, scale / kReliefFade));
    height = height + ScalarField{relief.height, relief.dx, relief.dy} * fade;
  } else {
    const ScalarField rise = stepOfRadius(rim, 1, scale / case_.head.bevel_width);
    const double h = case_.head.bone_height;
    height = height + ScalarField{h * rise.value, h * rise.dx, h * rise.dy};
  }
  return {{x, y, height.value}, {1, 0, height.dx}, {0, 1, height.dy}, rim, relief};
}

SurfaceSample PhantomScene::sample(int stage_index, double x, double y) const {
  SurfaceSample s = undeformed(x, y);
  if (stage_index == kUndeformed) return s;
  const Stage& stage = stages_[static_cast<std::size_t>(stage_index)];
  if (s.rim.value < 1) {
    const double scale = craniotomy_.smallestHalfAxis(), width = case_.head.window_width;
    const ScalarField window = complement(stepOfRadius(s.rim, 1 - width / scale, scale / width));

    const DeformationSettings& d = stage.deformation;
    Eigen::Vector3d shift = stage.shift, shift_x(0, 0, 0), shift_y(0, 0, 0);
    if (d.bulge != 0) {
      const double u = x - d.bulge_centre.x(), v = y - d.bulge_centre.y(), square = d.bulge_width * d.bulge_width;
      const double bulge = d.bulge * std::exp(-0.5 * (u * u + v * v) / square);
      shift.z() += bulge;
      shift_x.z() -= bulge * u / square;
      shift_y.z() -= bulge * v / square;
    }
    if (d.variation != 0) {
      for (int axis = 0; axis < 3; ++axis) {
        const auto& wave = stage.variation[static_cast<std::size_t>(axis)];
        const double angle = wave.kx * x + wave.ky * y + wave.phase;
        const double slope = -d.variation * std::sin(angle);
        shift[axis] += d.variation * std::cos(angle);
        shift_x[axis] += slope * wave.kx;
        shift_y[axis] += slope * wave.ky;
      }
    }
    s.point += window.value * shift;
    s.along_x += window.dx * shift + window.value * shift_x;
    s.along_y += window.dy * shift + window.value * shift_y;
  }
  if (stage.hole) {
    const double wall = stage.hole_settings.wall, hole_scale = stage.hole->smallestHalfAxis();
    const ScalarField brink = stepOfRadius(stage.hole->radius(x, y), 1 - wall / hole_scale, hole_scale / wall);
    const double depth = stage.hole_settings.depth;
    s.point.z() -= depth * (1 - brink.value);
    s.along_x.z() += depth * brink.dx;
    s.along_y.z() += depth * brink.dy;
  }
  return s;
}

Eigen::Vector3d PhantomScene::pointAt(int stage, double x, double y) const {
  return case_.T_pmr_brain * sample(stage, x, y).point;
}

Eigen::Vector3d PhantomScene::normalAt(int stage, double x, double y) const {
  const SurfaceSample s = sample(stage, x, y);
  return case_.T_pmr_brain.linear() * s.along_x.cross(s.along_y).normalized();
}

Eigen::Vector3d PhantomScene::displacement(int from, int to, double x, double y) const {
  return case_.T_pmr_brain.linear() * (sample(to, x, y).point - sample(from, x, y).point);
}

Material PhantomScene::materialAt(int stage_index, double x, double y) const {
  if (craniotomy_.radius(x, y).value >= 1) return Material::kRim;
  if (stage_index == kUndeformed) return Material::kBrain;
  const Stage& stage = stages_[static_cast<std::size_t>(stage_index)];
  for (const Outline& pool : stage.blood)
    if (pool.radius(x, y).value < 1) return Material::kBlood;
  if (stage.hole && stage.hole->radius(x, y).value < 1) return Material::kHole;
  return Material::kBrain;
}

double PhantomScene::rimDistance(const ScalarField& rim) const {
  const double slope = std::hypot(rim.dx, rim.dy);
  // Near the middle the slope vanishes and the distance is about a half axis.
  return (1 - rim.value) / std::max(slope, 1 / (2 * craniotomy_.smallestHalfAxis()));
}

bool PhantomScene::isInside(const ScalarField& rim, double distance) const {
  constexpr double kSurely = 1 + 1e-9;  // in spite of rounding
  const double gap = 1 - rim.value, least = 1 / (2 * craniotomy_.smallestHalfAxis());
  const double square = std::max(rim.dx * rim.dx + rim.dy * rim.dy, least * least);
  return gap > 0 && gap * gap > kSurely * distance * distance * square;
}

void PhantomScene::checkFolds(int stage) const {
  // The surface must stay one sheet over the brain's plane: in-plane Jacobian positive everywhere.
  constexpr double kReach = 0.07, kStep = 0.0005;
  for (double y = -kReach; y <= kReach; y += kStep)
    for (double x = -kReach; x <= kReach; x += kStep) {
      if (craniotomy_.radius(x, y).value >= 1) continue;
      const SurfaceSample s = sample(stage, x, y);
      if (s.along_x.x() * s.along_y.y() - s.along_x.y() * s.along_y.x() > 0.05) continue;
      throw PhantomCaseError("stage " + case_.stages[static_cast<std::size_t>(stage)].name +
                             " folds the surface at x = " + std::to_string(x) + ", y = " + std::to_string(y) +
                             " m; lower its lateral shift or widen head.window_width");
    }
}

std::optional<Eigen::Vector2d> PhantomScene::materialBelow(int stage, const Eigen::Vector3d& point_brain,
                                                           const Eigen::Vector2d& guess) const {
  Eigen::Vector2d m = guess;
  for (int i = 0; i < 60; ++i) {
    const SurfaceSample s = sample(stage, m.x(), m.y());
    const Eigen::Vector2d error = s.point.head<2>() - point_brain.head<2>();
    if (error.squaredNorm() < 1e-26) return m;
    Eigen::Matrix2d J;
    J << s.along_x.head<2>(), s.along_y.head<2>();
    Eigen::Vector2d step = J.inverse() * error;
    constexpr double kLongest = 0.003;  // [m]
    if (step.norm() > kLongest) step *= kLongest / step.norm();
    m -= step;
  }
  return std::nullopt;
}

std::optional<NearestPoint> PhantomScene::materialOf(const Eigen::Vector3d& point_pmr, int stage) const {
  const Eigen::Vector3d p = T_brain_pmr_ * point_pmr;
  const auto start = materialBelow(stage, p, p.head<2>());
  if (!start) return std::nullopt;
  // Levenberg-Marquardt on |S(x, y) - p|^2.
  Eigen::Vector2d m = *start;
  SurfaceSample s = sample(stage, m.x(), m.y());
  double damping = 1e-3;
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d error = s.point - p;
    Eigen::Matrix<double, 3, 2> J;
    J << s.along_x, s.along_y;
    const Eigen::Vector2d gradient = J.transpose() * error;
    Eigen::Matrix2d H = J.transpose() * J;
    H.diagonal() *= 1 + damping;
    const Eigen::Vector2d step = H.inverse() * gradient;
    const Eigen::Vector2d trial = m - step;
    const SurfaceSample trial_sample = sample(stage, trial.x(), trial.y());
    if ((trial_sample.point - p).squaredNorm() <= error.squaredNorm()) {
      m = trial;
      s = trial_sample;
      damping *= 0.1;
    } else {
      damping = std::max(1e-12, damping * 10);
    }
    if (step.norm() < 1e-11) break;
  }
  const Eigen::Vector3d gap = p - s.point;
  constexpr double kNear = 0.003;  // [m]
  if (gap.norm() > kNear) return std::nullopt;
  const bool outside = gap.dot(s.along_x.cross(s.along_y)) >= 0;
  return NearestPoint{m, outside ? gap.norm() : -gap.norm()};
}

std::optional<RayHit> PhantomScene::castRay(int stage, const Eigen::Vector3d& origin_pmr,
                                            const Eigen::Vector3d& direction_pmr) const {
  const Eigen::Vector3d origin = T_brain_pmr_ * origin_pmr;
  const Eigen::Vector3d direction = T_brain_pmr_.linear() * direction_pmr;
  std::optional<RayHit> hit;
  if (direction.z() < 0) {
    const double length = direction.norm();
    double from = (kSurfaceTop - origin.z()) / direction.z();
    const double end = (kSurfaceBottom - origin.z()) / direction.z();
    Eigen::Vector2d guess = (origin + from * direction).head<2>();
    // Height of a ray point above the sheet, by inverting the sheet's in-plane map below the point.
    const auto heightAt = [&](double t) -> std::optional<double> {
      const Eigen::Vector3d p = origin + t * direction;
      const auto m = materialBelow(stage, p, guess);
      if (!m) return std::nullopt;
      guess = *m;
      return p.z() - sample(stage, m->x(), m->y()).point.z();
    };
    auto above = heightAt(from);
    while (above && *above > 0 && from < end) {
      constexpr double kShortest = 1e-5, kLongest = 1e-3, kCaution = 0.1;  // steps [m], share of the height
      const double to = from + std::clamp(kCaution * *above, kShortest, kLongest) / length;
      const auto next = heightAt(to);
      if (next && *next <= 0) {
        double low = from, high = to;
        while ((high - low) * length > 1e-13) {
          const double middle = 0.5 * (low + high);
          const auto h = heightAt(middle);
          if (middle <= low || middle >= high || !h) break;
          (*h > 0 ? low : high) = middle;
        }
        heightAt(high);
        const Eigen::Vector3d p = origin + high * direction;
        hit = RayHit{high, guess, case_.T_pmr_brain * p, materialAt(stage, guess.x(), guess.y())};
        break;
      }
      from = to;
      above = next;
    }
  }
  const auto tool = hitInstrument(stage, origin, direction);
  if (tool && (!hit || tool->distance < hit->distance))
    hit = RayHit{tool->distance, Eigen::Vector2d(kNan, kNan), case_.T_pmr_brain * (origin + tool->distance * direction),
                 Material::kRetractor};
  return hit;
}

bool PhantomScene::isVisible(int stage, double x, double y, const View& view) const {
  const Eigen::Vector3d point = pointAt(stage, x, y);
  const auto pixel = view.project(point);
  if (!pixel || pixel->x() < -0.5 || pixel->y() < -0.5 || pixel->x() > view.size.width - 0.5 ||
      pixel->y() > view.size.height - 0.5)
    return false;
  const Eigen::Vector3d eye = view.T_pmr_camera.translation();
  const auto hit = castRay(stage, eye, point - eye);
  constexpr double kSame = 1e-5;  // [m]
  return hit && hit->what != Material::kRetractor && (hit->point_pmr - point).norm() < kSame;
}

}  // namespace cortshift_stereo_phantom
