#include "cortshift_stereo_phantom/phantom_renderer.hpp"

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "imaging/lens.hpp"
#include "imaging/rippled_film.hpp"
#include "sheet_solver.hpp"
#include "surface_paint.hpp"

namespace cortshift_stereo_phantom {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// Light that a surface sends to the camera.
class Shader {
 public:
  Shader(const PhantomScene& scene, int stage, const View& view, const SheetSolver& solver)
      : light_(scene.description().light),
        film_(scene.film()),
        lamp_(view.T_pmr_camera.inverse() * view.lamp_pmr),
        R_camera_brain_(solver.T_brain_camera().linear().transpose()),
        level_(R_camera_brain_ * Eigen::Vector3d::UnitZ()),
        casts_shadows_(stage != PhantomScene::kUndeformed &&
                       !scene.description().stages[static_cast<std::size_t>(stage)].rods.empty()),
        stage_(stage),
        scene_(scene),
        T_brain_camera_(solver.T_brain_camera()) {}

  /// @param point, normal in the camera frame; @param x, y carry the fine unevenness of the wet film [m]
  cv::Vec3f shade(const Paint& paint, const Eigen::Vector3d& point, const Eigen::Vector3d& surface_normal, double x,
                  double y) const {
    const double lit = casts_shadows_ ? scene_.lightPast(stage_, T_brain_camera_ * point, T_brain_camera_ * lamp_) : 1;
    const double film = paint.film;
    const Eigen::Vector3d normal = ((1 - film) * surface_normal + film * level_).normalized();
    const Eigen::Vector3d to_lamp = (lamp_ - point).normalized();
    const double lambert = std::max(0.0, normal.dot(to_lamp));
    cv::Vec3f out = paint.colour * static_cast<float>(light_.ambient + light_.diffuse * lambert * lit);
    if (light_.specular > 0 && paint.gloss > 0) {
      // Blinn-Phong on a normal that ripples with the fluid film: a few waves of 1.5 to 5 mm, none in step.
      const double strength = 0.04 * (1 - 0.85 * film);  // a deep pool lies calm
      const Eigen::Vector3d ripple(std::cos(3700 * x + 900 * y) + std::cos(1300 * x - 2100 * y + 1),
                                   std::cos(2900 * y - 1100 * x + 2) + std::cos(1700 * y + 1500 * x + 3), 0);
      const Eigen::Vector3d half = (to_lamp - point.normalized()).normalized();
      const double cosine = std::max(0.0, (normal + strength * ripple).normalized().dot(half));
      out += cv::Vec3f::all(static_cast<float>(light_.specular * paint.gloss * std::pow(cosine, light_.shininess)));
    }
    if (film_ != nullptr && paint.gloss > 0) {
      const Eigen::Vector2d slope = film_->slope(x, y) * (1 - 0.85 * film);
      const Eigen::Vector3d rippled =
          (normal - R_camera_brain_ * Eigen::Vector3d(slope.x(), slope.y(), 0)).normalized();
      out += cv::Vec3f::all(
          static_cast<float>(paint.gloss * lit * film_->mirrored(rippled, to_lamp, -point.normalized())));
    }
    return out;
  }

 private:
  LightSettings light_;
  const RippledFilm* film_;
  Eigen::Vector3d lamp_;
  Eigen::Matrix3d R_camera_brain_;
  Eigen::Vector3d level_;  // normal of a liquid that lies on the brain
  bool casts_shadows_;
  int stage_;
  const PhantomScene& scene_;
  Eigen::Isometry3d T_brain_camera_;
};

Eigen::Vector3d normalOf(const SurfaceSample& s) { return s.along_x.cross(s.along_y).normalized(); }

/// Instrument in front of whatever the ray meets at `depth`; distance is the camera depth as directions have z = 1.
std::optional<InstrumentHit> instrumentBefore(const PhantomScene& scene, int stage, const SheetSolver& solver,
                                              const Eigen::Vector2d& direction, double depth) {
  auto hit = scene.hitInstrument(stage, solver.T_brain_camera().translation(),
                                 solver.T_brain_camera().linear() * direction.homogeneous());
  if (!hit || hit->distance >= depth) return std::nullopt;
  hit->normal = solver.T_brain_camera().linear().transpose() * hit->normal;
  return hit;
}

}  // namespace

ViewTruth truthOf(const PhantomScene& scene, int stage, const View& view) {
  ViewTruth truth;
  truth.material = cv::Mat(view.size, CV_64FC2, cv::Scalar::all(kNan));
  truth.points_pmr = cv::Mat(view.size, CV_64FC3, cv::Scalar::all(kNan));
  truth.what = cv::Mat(view.size, CV_8UC1, cv::Scalar(static_cast<int>(Material::kNone)));
  const SheetSolver solver(scene, stage, view);
  cv::parallel_for_(cv::Range(0, view.size.height), [&](const cv::Range& range) {
    for (int row = range.start; row < range.end; ++row)
      for (int column = 0; column < view.size.width; ++column) {
        const Eigen::Vector2d direction = view.direction(column, row);
        const auto hit = solver.nearest(direction, column, row);
        const double depth = hit ? hit->surface.point.z() : std::numeric_limits<double>::infinity();
        const auto tool = instrumentBefore(scene, stage, solver, direction, depth);
        if (!tool && !hit) continue;
        Material what = Material::kRetractor;
        if (!tool) {
          truth.material.at<cv::Vec2d>(row, column) = {hit->material.x(), hit->material.y()};
          what = scene.materialAt(stage, hit->material.x(), hit->material.y());
        }
        const Eigen::Vector3d p =
            view.T_pmr_camera * (tool ? Eigen::Vector3d(tool->distance * direction.homogeneous()) : hit->surface.point);
        truth.points_pmr.at<cv::Vec3d>(row, column) = {p.x(), p.y(), p.z()};
        truth.what.at<uchar>(row, column) = static_cast<uchar>(what);
      }
  });
  return truth;
}

cv::Mat renderView(const PhantomScene& scene, int stage, const View& view, int supersampling, cv::Mat* depths) {
  const PhantomCase& description = scene.description();
  const SheetSolver solver(scene, stage, view);
  const SurfacePaint paint(scene, stage);
  const Shader shader(scene, stage, view, solver);
  const double gain =
      stage == PhantomScene::kUndeformed ? 1.0 : description.stages[static_cast<std::size_t>(stage)].gain;
  const double corner_square = 0.25 * (view.size.width * view.size.width + view.size.height * view.size.height);

  /// One ray; `centre` is the hit of its pixel's middle, from which a ray nearby is one chord step away.
  const auto trace = [&](const Eigen::Vector2d& direction, int column, int row, const std::optional<SheetHit>& centre,
                         const Eigen::Vector2d& centre_direction) -> cv::Vec3f {
    std::optional<SheetHit> hit;
    if (centre && !solver.isFolded(column, row)) {
      hit = centre;
      hit->material += centre->image_to_material * (direction - centre_direction);
      hit->surface = solver.sample(hit->material);
      const Eigen::Vector2d correction = centre->image_to_material * (direction - hit->surface.point.hnormalized());
      constexpr double kSmallCorrection =
          5e-6;  // [m]; what is left after the step is its square over the relief's size
      if (correction.norm() < kSmallCorrection) {
        hit->material += correction;
        hit->surface.rim.value += hit->surface.rim.dx * correction.x() + hit->surface.rim.dy * correction.y();
      } else
        hit = solver.solve(direction, hit->material);
    }
    if (!hit) hit = solver.nearest(direction, column, row);
    const double depth = hit ? hit->surface.point.z() : std::numeric_limits<double>::infinity();
    if (const auto tool = instrumentBefore(scene, stage, solver, direction, depth))
      return shader.shade(SurfacePaint::steel(tool->on_surface), tool->distance * direction.homogeneous(), tool->normal,
                          tool->on_surface.x(), tool->on_surface.y());
    if (!hit) return {0, 0, 0};
    const double x = hit->material.x(), y = hit->material.y();
    return shader.shade(paint.at(x, y, hit->surface), hit->surface.point, normalOf(hit->surface), x, y);
  };

  cv::Mat light(view.size, CV_32FC3);
  if (depths != nullptr) *depths = cv::Mat(view.size, CV_32FC1, cv::Scalar(kNan));
  cv::parallel_for_(cv::Range(0, view.size.height), [&](const cv::Range& range) {
    // What two pixels have between them is undistorted once.
    std::vector<Eigen::Vector2d> above(static_cast<std::size_t>(view.size.width));
    for (int column = 0; column < view.size.width; ++column)
      above[static_cast<std::size_t>(column)] = view.direction(column, range.start - 0.5);
    for (int row = range.start; row < range.end; ++row) {
      Eigen::Vector2d before = view.direction(-0.5, row);
      for (int column = 0; column < view.size.width; ++column) {
        const Eigen::Vector2d direction = view.direction(column, row);
        std::optional<SheetHit> centre;
        if (!solver.isFolded(column, row)) centre = solver.nearest(direction, column, row);
        if (depths != nullptr) {
          const auto hit = centre ? centre : solver.nearest(direction, column, row);
          double depth = hit ? hit->surface.point.z() : std::numeric_limits<double>::infinity();
          if (const auto tool = instrumentBefore(scene, stage, solver, direction, depth)) depth = tool->distance;
          if (std::isfinite(depth)) depths->at<float>(row, column) = static_cast<float>(depth);
        }
        cv::Vec3f sum(0, 0, 0);
        // Within a pixel the distortion is linear to 1e-10.
        const Eigen::Vector2d after = view.direction(column + 0.5, row), below = view.direction(column, row + 0.5);
        const Eigen::Vector2d along_u = after - std::exchange(before, after);
        const Eigen::Vector2d along_v = below - std::exchange(above[static_cast<std::size_t>(column)], below);
        for (int j = 0; j < supersampling; ++j)
          for (int i = 0; i < supersampling; ++i)
            sum += trace(
                direction + ((i + 0.5) / supersampling - 0.5) * along_u + ((j + 0.5) / supersampling - 0.5) * along_v,
                column, row, centre, direction);
        const double du = column - 0.5 * (view.size.width - 1), dv = row - 0.5 * (view.size.height - 1);
        const double falloff = 1 - description.image.vignette * (du * du + dv * dv) / corner_square;
        light.at<cv::Vec3f>(row, column) =
            sum * static_cast<float>(gain * falloff / (static_cast<double>(supersampling) * supersampling));
      }
    }
  });
  return light;
}

cv::Mat sensorLight(const PhantomScene& scene, int stage, Side side, const Eigen::Isometry3d& moved) {
  const PhantomCase& description = scene.description();
  const ImageSettings& image = description.image;
  View view = scene.view(stage, side);
  if (!moved.isApprox(Eigen::Isometry3d::Identity())) view.T_pmr_camera = view.T_pmr_camera * moved;
  cv::Mat depth;
  cv::Mat light = renderView(scene, stage, view, image.supersampling, image.depth_of_field > 0 ? &depth : nullptr);
  const double focus =
      std::hypot(description.cameras.working_distance, 0.5 * description.cameras.baseline) + image.focus_offset;
  if (!depth.empty()) light = outOfFocus(light, depth, focus, 1e3 * image.depth_of_field);
  if (side == Side::kRight) light = light * image.right_gain;
  return respond(light, side == Side::kLeft ? image.left : image.right);
}

PhantomPairs::PhantomPairs(std::shared_ptr<const PhantomScene> scene)
    : scene_(std::move(scene)), sensor_(scene_->description().image) {}

std::shared_ptr<const PhantomScene> PhantomPairs::sceneAt(std::uint64_t frame) {
  const double outward = scene_->description().motion.outwardAt(frame);
  if (outward == 0) return scene_;
  const std::lock_guard<std::mutex> lock(mutex_);
  auto& state = states_[outward];
  if (!state) state = std::make_shared<const PhantomScene>(scene_->description().atPair(frame));
  return state;
}

const PhantomPairs::Prepared& PhantomPairs::prepared(int stage, std::uint64_t frame) {
  const auto scene = sceneAt(frame);
  std::unique_lock<std::mutex> lock(mutex_);
  Prepared& entry = stages_[{stage, scene_->description().motion.outwardAt(frame)}];
  lock.unlock();
  std::call_once(entry.once, [&] {
    entry.left = Sensor::prepare(sensorLight(*scene, stage, Side::kLeft));
    entry.right = Sensor::prepare(sensorLight(*scene, stage, Side::kRight));
  });
  return entry;
}

StereoImages PhantomPairs::take(int stage, std::uint64_t frame) {
  const Prepared& light = prepared(stage, frame);
  return {sensor_.expose(light.left, frame, Side::kLeft), sensor_.expose(light.right, frame, Side::kRight)};
}

}  // namespace cortshift_stereo_phantom
