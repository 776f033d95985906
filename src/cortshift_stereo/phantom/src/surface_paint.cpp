#include "surface_paint.hpp"

#include <cmath>

#include "random.hpp"
#include "scene_stage.hpp"
#include "smooth_step.hpp"

namespace cortshift_stereo_phantom {
namespace {

const cv::Vec3f kBlood(0.055F, 0.045F, 0.30F), kDura(0.62F, 0.66F, 0.80F), kBone(0.62F, 0.74F, 0.80F);
const cv::Vec3f kDrape(0.52F, 0.40F, 0.16F), kCavity(0.42F, 0.50F, 0.72F), kCavityBlood(0.14F, 0.12F, 0.46F);

constexpr double kSeam = 0.00025;      // half width of the step between two materials [m]
constexpr double kDuraWidth = 0.0022;  // cuff of dura around the brain [m]
constexpr double kBoneWidth = 0.0085;  // from the rim to the drape [m]

/// Gradient-free value noise of a few waves, about -1...1.
double waves(double x, double y, double wavelength, std::uint64_t seed) {
  Random random(seed);
  double sum = 0;
  constexpr int kWaves = 6;
  for (int i = 0; i < kWaves; ++i) {
    const double k = 6.283185307179586 / wavelength * (0.6 + 0.8 * random.uniform());
    const double heading = 6.283185307179586 * random.uniform();
    sum += std::cos(k * (std::cos(heading) * x + std::sin(heading) * y) + 6.283185307179586 * random.uniform());
  }
  return sum / std::sqrt(0.5 * kWaves);
}

cv::Vec3f mix(const cv::Vec3f& a, const cv::Vec3f& b, double share) {
  return a * static_cast<float>(1 - share) + b * static_cast<float>(share);
}

}  // namespace

SurfacePaint::SurfacePaint(const PhantomScene& scene, int stage) : scene_(scene), stage_(stage) {}

cv::Vec3f SurfacePaint::rim(double x, double y, double outside) const {
  const double coarse = waves(x, y, 0.004, 11), fine = waves(x, y, 0.0009, 12);
  const double edge = outside + 0.0005 * waves(x, y, 0.006, 13);  // no seam is a perfect line
  const cv::Vec3f dura = kDura * static_cast<float>(1 + 0.05 * coarse + 0.04 * fine);
  // Bone: pores, and the bleeding marrow in blotches.
  const double pores = smoothStep((fine - 0.8) / 0.6), marrow = smoothStep((coarse - 0.6) / 0.8);
  cv::Vec3f bone = mix(kBone * static_cast<float>(1 + 0.05 * coarse), cv::Vec3f(0.30F, 0.32F, 0.55F), 0.6 * marrow);
  bone = mix(bone, cv::Vec3f(0.25F, 0.28F, 0.42F), 0.5 * pores);
  // Drape: woven threads, and folds.
  const double weave = std::sin(x * 6283.0 / 0.7) * std::sin(y * 6283.0 / 0.7);
  const cv::Vec3f drape = kDrape * static_cast<float>(1 + 0.16 * weave + 0.14 * coarse + 0.08 * fine);
  const cv::Vec3f inner = mix(dura, bone, smoothStep((edge - kDuraWidth) / (2 * kSeam) + 0.5));
  return mix(inner, drape, smoothStep((edge - kBoneWidth) / (2 * kSeam) + 0.5));
}

Paint SurfacePaint::at(double x, double y) const {
  const double inside = scene_.rimDistance(x, y);
  Paint paint{{0, 0, 0}, 0.25F};
  const double rim_share = smoothStep(0.5 - inside / (2 * kSeam));
  if (rim_share < 1) {
    paint = {scene_.texture().colour(x, y), 1.0F};
    if (stage_ != PhantomScene::kUndeformed && scene_.stages_[static_cast<std::size_t>(stage_)].hole) {
      const auto& hole = *scene_.stages_[static_cast<std::size_t>(stage_)].hole;
      const double within = (1 - hole.radius(x, y).value) * hole.smallestHalfAxis();
      const double share = smoothStep(within / (2 * kSeam) + 0.5);
      if (share > 0) {
        const double blotch = smoothStep(0.5 + 0.8 * waves(x, y, 0.0035, 21)), grain = waves(x, y, 0.0008, 22);
        const double shade = 1 - 0.45 * smoothStep(within / 0.006);  // little light reaches the floor
        const cv::Vec3f cavity = mix(kCavity, kCavityBlood, 0.75 * blotch) * static_cast<float>(shade + 0.07 * grain);
        paint.colour = mix(paint.colour, cavity, share);
      }
    }
  }
  if (rim_share > 0) {
    paint.colour = mix(paint.colour, rim(x, y, -inside), rim_share);
    paint.gloss = static_cast<float>(paint.gloss * (1 - 0.9 * rim_share));
  }
  if (stage_ != PhantomScene::kUndeformed) {
    const auto& stage = scene_.stages_[static_cast<std::size_t>(stage_)];
    const auto& settings = scene_.description().stages[static_cast<std::size_t>(stage_)].blood;
    for (std::size_t i = 0; i < stage.blood.size(); ++i) {
      const Outline& pool = stage.blood[i];
      const double within = (1 - pool.radius(x, y).value) * pool.smallestHalfAxis();
      const double share = smoothStep(within / settings[i].border + 0.5);
      if (share <= 0) continue;
      const double thick = smoothStep(within / 0.004);  // darker where it is deep
      paint.colour = mix(paint.colour, kBlood * static_cast<float>(1.25 - 0.4 * thick), share);
      paint.gloss = 1.0F;
    }
  }
  return paint;
}

Paint SurfacePaint::steel(const Eigen::Vector2d& on_blade) {
  const double scratches = waves(on_blade.x() * 0.05, on_blade.y(), 0.0006, 31);
  const float grey = static_cast<float>(0.55 + 0.05 * scratches);
  return {cv::Vec3f(grey * 1.03F, grey, grey * 0.97F), 0.6F};
}

}  // namespace cortshift_stereo_phantom
