// Instruments of a phantom scene: blades and rods.
#include <cmath>

#include "cortshift_stereo_phantom/phantom_scene.hpp"
#include "smooth_step.hpp"

namespace cortshift_stereo_phantom {
namespace {

Eigen::Vector3d handleDirection(double heading, double slope) {
  return {std::cos(heading) * std::cos(slope), std::sin(heading) * std::cos(slope), std::sin(slope)};
}

std::optional<InstrumentHit> hitBlade(const RetractorSettings& blade, const Eigen::Vector3d& origin,
                                      const Eigen::Vector3d& direction) {
  const double c = std::cos(blade.heading), s = std::sin(blade.heading);
  const Eigen::Vector3d along = handleDirection(blade.heading, blade.slope);
  const Eigen::Vector3d across(-s, c, 0), normal = along.cross(across);
  const double approach = direction.dot(normal);
  if (std::abs(approach) < 1e-12) return std::nullopt;
  const double distance = (blade.tip - origin).dot(normal) / approach;
  if (distance <= 0) return std::nullopt;
  const Eigen::Vector3d offset = origin + distance * direction - blade.tip;
  const Eigen::Vector2d on_blade(offset.dot(along), offset.dot(across));
  const double half = 0.5 * blade.width;
  const bool in_shaft = on_blade.x() >= half && on_blade.x() <= blade.length && std::abs(on_blade.y()) <= half;
  const bool in_end = (on_blade - Eigen::Vector2d(half, 0)).norm() <= half;
  if (!in_shaft && !in_end) return std::nullopt;
  const Eigen::Vector3d face(-c * std::sin(blade.slope), -s * std::sin(blade.slope), std::cos(blade.slope));
  return InstrumentHit{distance, on_blade, face};
}

/// The axis of a rod between the middles of its rounded ends.
struct RodAxis {
  explicit RodAxis(const RodSettings& rod)
      : along(handleDirection(rod.heading, rod.slope)),
        radius(0.5 * rod.diameter),
        length(rod.length - rod.diameter),
        start(rod.tip + radius * along) {}
  Eigen::Vector3d along;
  double radius, length;
  Eigen::Vector3d start;
};

std::optional<InstrumentHit> hitRod(const RodSettings& rod, const Eigen::Vector3d& origin,
                                    const Eigen::Vector3d& direction) {
  const RodAxis axis(rod);
  const Eigen::Vector3d from = origin - axis.start;
  const auto nearRoot = [](double a, double half_b, double c) -> std::optional<double> {
    const double square = half_b * half_b - a * c;
    if (square < 0 || a <= 0) return std::nullopt;
    const double distance = (-half_b - std::sqrt(square)) / a;
    if (distance <= 0) return std::nullopt;
    return distance;
  };
  const auto hitAt = [&](double distance, const Eigen::Vector3d& middle) {
    const Eigen::Vector3d at = from + distance * direction;
    const Eigen::Vector3d normal = (at - middle) / axis.radius;
    return InstrumentHit{
        distance, {at.dot(axis.along), axis.radius * std::asin(std::clamp(normal.x(), -1.0, 1.0))}, normal};
  };
  const Eigen::Vector3d across = direction - direction.dot(axis.along) * axis.along;
  const Eigen::Vector3d beside = from - from.dot(axis.along) * axis.along;
  const double square = axis.radius * axis.radius;
  if (const auto t = nearRoot(across.squaredNorm(), across.dot(beside), beside.squaredNorm() - square)) {
    const double place = (from + *t * direction).dot(axis.along);
    if (place >= 0 && place <= axis.length) return hitAt(*t, place * axis.along);
  }
  std::optional<InstrumentHit> best;
  for (const double end : {0.0, axis.length}) {
    const Eigen::Vector3d middle = end * axis.along, offset = from - middle;
    const auto t = nearRoot(direction.squaredNorm(), direction.dot(offset), offset.squaredNorm() - square);
    if (t && (!best || *t < best->distance)) best = hitAt(*t, middle);
  }
  return best;
}

}  // namespace

std::optional<InstrumentHit> PhantomScene::hitInstrument(int stage, const Eigen::Vector3d& origin,
                                                         const Eigen::Vector3d& direction) const {
  if (stage == kUndeformed) return std::nullopt;
  const StageSettings& settings = case_.stages[static_cast<std::size_t>(stage)];
  std::optional<InstrumentHit> nearest;
  if (settings.retractor) nearest = hitBlade(*settings.retractor, origin, direction);
  for (const RodSettings& rod : settings.rods) {
    const auto hit = hitRod(rod, origin, direction);
    if (hit && (!nearest || hit->distance < nearest->distance)) nearest = hit;
  }
  return nearest;
}

double PhantomScene::lightPast(int stage, const Eigen::Vector3d& point, const Eigen::Vector3d& lamp) const {
  if (stage == kUndeformed) return 1;
  double share = 1;
  for (const RodSettings& rod : case_.stages[static_cast<std::size_t>(stage)].rods) {
    // Where the ray to the lamp passes nearest to the rod's axis (Ericson, Real-Time Collision Detection, 5.1.9).
    const RodAxis axis(rod);
    const Eigen::Vector3d ray = lamp - point, between = point - axis.start;
    const double a = ray.squaredNorm(), b = ray.dot(axis.along), c = ray.dot(between), f = axis.along.dot(between);
    const double determinant = std::max(1e-12, a - b * b);
    double on_ray = std::clamp((b * f - c) / determinant, 0.0, 1.0);
    const double on_rod = std::clamp(b * on_ray + f, 0.0, axis.length);
    on_ray = std::clamp((b * on_rod - c) / a, 0.0, 1.0);
    const double gap = (between + on_ray * ray - on_rod * axis.along).norm() - axis.radius;
    // Half shadow: a lamp of finite size is hidden little by little.
    constexpr double kLampRadius = 0.008;  // [m]
    const double half_shadow = std::max(1e-5, kLampRadius * on_ray / std::max(1e-6, 1 - on_ray));
    share *= smoothStep(0.5 + 0.5 * gap / half_shadow);
  }
  return share;
}

}  // namespace cortshift_stereo_phantom
