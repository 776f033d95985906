#include "cortshift_stereo_phantom/phantom_renderer.hpp"

#include <cmath>
#include <limits>

#include "random.hpp"
#include "sheet_solver.hpp"
#include "surface_paint.hpp"

namespace cortshift_stereo_phantom {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// Light that a surface sends to the camera.
class Shader {
 public:
  /// @param level_camera normal of a liquid that lies on the brain
  Shader(const LightSettings& light, const Eigen::Vector3d& lamp_camera, const Eigen::Vector3d& level_camera)
      : light_(light), lamp_(lamp_camera), level_(level_camera) {}

  /// @param point, normal in the camera frame; @param x, y carry the fine unevenness of the wet film [m]
  cv::Vec3f shade(const Paint& paint, const Eigen::Vector3d& point, const Eigen::Vector3d& surface_normal, double x,
                  double y) const {
    const double film = paint.film;
    const Eigen::Vector3d normal = ((1 - film) * surface_normal + film * level_).normalized();
    const Eigen::Vector3d to_lamp = (lamp_ - point).normalized();
    const double lambert = std::max(0.0, normal.dot(to_lamp));
    cv::Vec3f out = paint.colour * static_cast<float>(light_.ambient + light_.diffuse * lambert);
    if (light_.specular > 0 && paint.gloss > 0) {
      // Blinn-Phong on a normal that ripples with the fluid film: a few waves of 1.5 to 5 mm, none in step.
      const double strength = 0.04 * (1 - 0.85 * film);  // a deep pool lies calm
      const Eigen::Vector3d ripple(std::cos(3700 * x + 900 * y) + std::cos(1300 * x - 2100 * y + 1),
                                   std::cos(2900 * y - 1100 * x + 2) + std::cos(1700 * y + 1500 * x + 3), 0);
      const Eigen::Vector3d half = (to_lamp - point.normalized()).normalized();
      const double cosine = std::max(0.0, (normal + strength * ripple).normalized().dot(half));
      out += cv::Vec3f::all(static_cast<float>(light_.specular * paint.gloss * std::pow(cosine, light_.shininess)));
    }
    return out;
  }

 private:
  LightSettings light_;
  Eigen::Vector3d lamp_, level_;
};

Eigen::Vector3d normalOf(const SurfaceSample& s) { return s.along_x.cross(s.along_y).normalized(); }

/// Blade in front of whatever the ray meets at `depth`; distance is the camera depth as directions have z = 1.
std::optional<std::pair<double, Eigen::Vector2d>> bladeBefore(const PhantomScene& scene, int stage,
                                                              const SheetSolver& solver,
                                                              const Eigen::Vector2d& direction, double depth) {
  const auto blade = scene.hitRetractor(stage, solver.T_brain_camera().translation(),
                                        solver.T_brain_camera().linear() * direction.homogeneous());
  if (blade && blade->first < depth) return blade;
  return std::nullopt;
}

Eigen::Vector3d bladeNormal(const PhantomScene& scene, int stage, const SheetSolver& solver) {
  const auto& blade = scene.description().stages[static_cast<std::size_t>(stage)].retractor;
  if (!blade) return Eigen::Vector3d::UnitZ();
  const double c = std::cos(blade->heading), s = std::sin(blade->heading);
  const Eigen::Vector3d normal(-c * std::sin(blade->slope), -s * std::sin(blade->slope), std::cos(blade->slope));
  return solver.T_brain_camera().linear().transpose() * normal;
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
        const auto blade = bladeBefore(scene, stage, solver, direction, depth);
        if (!blade && !hit) continue;
        Material what = Material::kRetractor;
        if (!blade) {
          truth.material.at<cv::Vec2d>(row, column) = {hit->material.x(), hit->material.y()};
          what = scene.materialAt(stage, hit->material.x(), hit->material.y());
        }
        const Eigen::Vector3d p =
            view.T_pmr_camera * (blade ? Eigen::Vector3d(blade->first * direction.homogeneous()) : hit->surface.point);
        truth.points_pmr.at<cv::Vec3d>(row, column) = {p.x(), p.y(), p.z()};
        truth.what.at<uchar>(row, column) = static_cast<uchar>(what);
      }
  });
  return truth;
}

cv::Mat renderView(const PhantomScene& scene, int stage, const View& view, int supersampling) {
  const PhantomCase& description = scene.description();
  const SheetSolver solver(scene, stage, view);
  const SurfacePaint paint(scene, stage);
  const Shader shader(description.light, view.T_pmr_camera.inverse() * view.lamp_pmr,
                      solver.T_brain_camera().linear().transpose() * Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d blade_normal = bladeNormal(scene, stage, solver);
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
    if (const auto blade = bladeBefore(scene, stage, solver, direction, depth))
      return shader.shade(SurfacePaint::steel(blade->second), blade->first * direction.homogeneous(), blade_normal,
                          blade->second.x(), blade->second.y());
    if (!hit) return {0, 0, 0};
    const double x = hit->material.x(), y = hit->material.y();
    return shader.shade(paint.at(x, y, hit->surface), hit->surface.point, normalOf(hit->surface), x, y);
  };

  cv::Mat light(view.size, CV_32FC3);
  cv::parallel_for_(cv::Range(0, view.size.height), [&](const cv::Range& range) {
    for (int row = range.start; row < range.end; ++row)
      for (int column = 0; column < view.size.width; ++column) {
        const Eigen::Vector2d direction = view.direction(column, row);
        std::optional<SheetHit> centre;
        if (!solver.isFolded(column, row)) centre = solver.nearest(direction, column, row);
        cv::Vec3f sum(0, 0, 0);
        // Within a pixel the distortion is linear to 1e-10.
        const Eigen::Vector2d along_u = view.direction(column + 0.5, row) - view.direction(column - 0.5, row);
        const Eigen::Vector2d along_v = view.direction(column, row + 0.5) - view.direction(column, row - 0.5);
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
  });
  return light;
}

namespace {

constexpr int kSubLevels = 64;  // steps of a prepared image per grey level
constexpr std::size_t kTableSize = 1U << 20;

}  // namespace

Sensor::Sensor(double noise, std::uint32_t seed) : seed_(seed) {
  if (noise <= 0) return;
  // A long table of normal deviates; every row of every frame starts at its own place in it.
  Random random(seed);
  constexpr int kLongestRow = 3 * 8192;
  table_.resize(kTableSize + kLongestRow);
  for (std::size_t i = 0; i < kTableSize; i += 2) {
    const double radius = std::sqrt(-2 * std::log(1 - random.uniform())), angle = 6.283185307179586 * random.uniform();
    for (const std::size_t k : {std::size_t{0}, std::size_t{1}}) {
      const double deviate = radius * (k == 0 ? std::cos(angle) : std::sin(angle));
      table_[i + k] =
          static_cast<std::int16_t>(std::lround(std::clamp(deviate * noise * 255 * kSubLevels, -15e3, 15e3)));
    }
  }
  std::copy(table_.begin(), table_.begin() + kLongestRow, table_.begin() + kTableSize);
}

cv::Mat Sensor::prepare(const cv::Mat& light) {
  cv::Mat prepared;
  cv::min(light, 1.0, prepared);  // the well is full
  prepared.convertTo(prepared, CV_16SC3, 255.0 * kSubLevels);
  return prepared;
}

cv::Mat Sensor::expose(const cv::Mat& prepared, std::uint64_t frame, Side side) const {
  cv::Mat image(prepared.size(), CV_8UC3);
  const int values = 3 * prepared.cols;
  Random random(seed_ ^ mixBits(2 * frame + (side == Side::kRight ? 1 : 0)));
  for (int row = 0; row < prepared.rows; ++row) {
    const std::int16_t* in = prepared.ptr<std::int16_t>(row);
    uchar* out = image.ptr<uchar>(row);
    const std::int16_t* noise = table_.empty() ? nullptr : &table_[random.bits() % kTableSize];
    for (int i = 0; i < values; ++i) {
      const int level = (in[i] + (noise != nullptr ? noise[i] : 0) + kSubLevels / 2) >> 6;
      out[i] = static_cast<uchar>(std::clamp(level, 0, 255));
    }
  }
  return image;
}

PhantomPairs::PhantomPairs(std::shared_ptr<const PhantomScene> scene)
    : scene_(std::move(scene)), sensor_(scene_->description().image.noise, scene_->description().image.noise_seed) {}

const PhantomPairs::Prepared& PhantomPairs::prepared(int stage) {
  std::unique_lock<std::mutex> lock(mutex_);
  Prepared& entry = stages_[stage];
  lock.unlock();
  std::call_once(entry.once, [&] {
    const ImageSettings& image = scene_->description().image;
    const auto render = [&](Side side) {
      return renderView(*scene_, stage, scene_->view(stage, side), image.supersampling);
    };
    entry.left = Sensor::prepare(render(Side::kLeft));
    entry.right = Sensor::prepare(render(Side::kRight) * image.right_gain);
  });
  return entry;
}

StereoImages PhantomPairs::take(int stage, std::uint64_t frame) {
  const Prepared& light = prepared(stage);
  return {sensor_.expose(light.left, frame, Side::kLeft), sensor_.expose(light.right, frame, Side::kRight)};
}

}  // namespace cortshift_stereo_phantom
