#include "surface_paint.hpp"

#include <cmath>

#include "cortshift_flow/vectorised.hpp"
#include "cortshift_flow_phantom/plane_waves.hpp"
#include "imaging/tissue_picture.hpp"
#include "random.hpp"
#include "scene_stage.hpp"
#include "smooth_step.hpp"

namespace cortshift_stereo_phantom {
namespace {

const cv::Vec3f kBlood(0.055F, 0.045F, 0.30F), kDura(0.62F, 0.66F, 0.80F), kBone(0.62F, 0.74F, 0.80F);
const cv::Vec3f kDrape(0.52F, 0.40F, 0.16F), kCavity(0.42F, 0.50F, 0.72F), kCavityBlood(0.14F, 0.12F, 0.46F);
const cv::Vec3f kCotton(0.86F, 0.88F, 0.90F);

constexpr double kSeam = 0.00025;      // half width of the step between two materials [m]
constexpr double kDuraWidth = 0.0022;  // cuff of dura around the brain [m]
constexpr double kBoneWidth = 0.0085;  // from the rim to the drape [m]

/// An uneven pattern of a few waves in random directions, about -1...1.
class Pattern {
 public:
  Pattern(double wavelength, std::uint64_t seed) {
    Random random(seed);
    constexpr double kTurn = 6.283185307179586;
    for (std::size_t i = 0; i < waves_.size(); ++i) {
      const double k = kTurn / wavelength * (0.6 + 0.8 * random.uniform()), heading = kTurn * random.uniform();
      waves_.set(i, k * std::cos(heading), k * std::sin(heading), kTurn * random.uniform());
    }
  }

  double operator()(double x, double y) const {
    return waves_.sum(x, y) / std::sqrt(0.5 * static_cast<double>(waves_.size()));
  }

 private:
  cortshift_flow_phantom::PlaneWaves<7> waves_;
};

cv::Vec3f mix(const cv::Vec3f& a, const cv::Vec3f& b, double share) {
  return a * static_cast<float>(1 - share) + b * static_cast<float>(share);
}

/// @param edge distance from the rim [m]; @param coarse, fine patterns there
cv::Vec3f duraOrBone(double edge, double coarse, double fine) {
  const cv::Vec3f dura = kDura * static_cast<float>(1 + 0.05 * coarse + 0.04 * fine);
  // Bone: pores, and the bleeding marrow in blotches.
  const double pores = smoothStep((fine - 0.8) / 0.6), marrow = smoothStep((coarse - 0.6) / 0.8);
  cv::Vec3f bone = mix(kBone * static_cast<float>(1 + 0.05 * coarse), cv::Vec3f(0.30F, 0.32F, 0.55F), 0.6 * marrow);
  bone = mix(bone, cv::Vec3f(0.25F, 0.28F, 0.42F), 0.5 * pores);
  return mix(dura, bone, smoothStep((edge - kDuraWidth) / (2 * kSeam) + 0.5));
}

}  // namespace

SurfacePaint::SurfacePaint(const PhantomScene& scene, int stage) : scene_(scene), stage_(stage) {}

CORTSHIFT_VECTORISED
cv::Vec3f SurfacePaint::rim(double x, double y, double outside) const {
  static const Pattern kCoarse(0.004, 11), kFine(0.0009, 12), kSeams(0.008, 13);
  constexpr double kUneven = 0.0003, kMost = 4;  // no seam is a perfect line; a pattern is 7 / sqrt(3.5) at most
  const bool all_drape = outside > kBoneWidth + kSeam + kMost * kUneven;
  const double edge = all_drape ? outside : outside + kUneven * kSeams(x, y);
  const double drape_share = smoothStep((edge - kBoneWidth) / (2 * kSeam) + 0.5);
  cv::Vec3f inner(0, 0, 0), drape(0, 0, 0);
  if (drape_share < 1) inner = duraOrBone(edge, kCoarse(x, y), kFine(x, y));
  if (drape_share > 0) {
    // Woven threads, and folds. It may slide.
    const Eigen::Vector2d slid = stage_ == PhantomScene::kUndeformed
                                     ? Eigen::Vector2d(0, 0)
                                     : scene_.description().stages[static_cast<std::size_t>(stage_)].drape;
    const double u = x - slid.x(), v = y - slid.y();
    const double weave = std::sin(u * 6283.0 / 0.7) * std::sin(v * 6283.0 / 0.7);
    drape = kDrape * static_cast<float>(1 + 0.16 * weave + 0.14 * kCoarse(u, v) + 0.08 * kFine(u, v));
  }
  return mix(inner, drape, drape_share);
}

Paint SurfacePaint::at(double x, double y, const SurfaceSample& surface) const {
  Paint paint{{0, 0, 0}, 1.0F};
  const double inside = scene_.isInside(surface.rim, kSeam) ? kSeam : scene_.rimDistance(surface.rim);
  const double rim_share = smoothStep(0.5 - inside / (2 * kSeam));
  if (rim_share < 1) {
    if (scene_.picture() != nullptr)
      paint.colour = scene_.picture()->colour(x, y);
    else
      paint.colour =
          surface.rim.value < 1 ? scene_.texture().colour(x, y, surface.relief) : scene_.texture().colour(x, y);
    if (stage_ != PhantomScene::kUndeformed) paintHole(x, y, paint);
  }
  if (rim_share > 0) {
    paint.colour = mix(paint.colour, rim(x, y, -inside), rim_share);
    paint.gloss = static_cast<float>(paint.gloss * (1 - 0.95 * rim_share));
  }
  if (stage_ != PhantomScene::kUndeformed) paintBlood(x, y, paint);
  return paint;
}

void SurfacePaint::paintHole(double x, double y, Paint& paint) const {
  const auto& hole = scene_.stages_[static_cast<std::size_t>(stage_)].hole;
  if (!hole) return;
  const double within = (1 - hole->radius(x, y).value) * hole->smallestHalfAxis();
  const double share = smoothStep(within / (2 * kSeam) + 0.5);
  if (share <= 0) return;
  static const Pattern kBlotches(0.0035, 21), kGrain(0.0008, 22);
  const double shade = 1 - 0.4 * smoothStep(within / 0.006);  // little light reaches the floor
  const cv::Vec3f cavity = mix(kCavity, kCavityBlood, 0.7 * smoothStep(0.5 + 0.6 * kBlotches(x, y))) *
                           static_cast<float>(shade + 0.06 * kGrain(x, y));
  paint.colour = mix(paint.colour, cavity, share);
  paint.gloss = static_cast<float>(paint.gloss * (1 - 0.6 * share));
}

void SurfacePaint::paintBlood(double x, double y, Paint& paint) const {
  const auto& pools = scene_.stages_[static_cast<std::size_t>(stage_)].blood;
  const auto& settings = scene_.description().stages[static_cast<std::size_t>(stage_)].blood;
  for (std::size_t i = 0; i < pools.size(); ++i) {
    const double within = (1 - pools[i].radius(x, y).value) * pools[i].smallestHalfAxis();
    const double share = smoothStep(within / settings[i].border + 0.5);
    if (share <= 0) continue;
    if (settings[i].cotton) {
      static const Pattern kFibres(0.0007, 41), kFolds(0.005, 42);
      paint.colour =
          mix(paint.colour, kCotton * static_cast<float>(1 + 0.06 * kFibres(x, y) + 0.05 * kFolds(x, y)), share);
      paint.gloss = static_cast<float>(paint.gloss * (1 - share));
      continue;
    }
    const double thick = smoothStep(within / 0.004);  // darker where it is deep
    paint.colour = mix(paint.colour, kBlood * static_cast<float>(1.25 - 0.4 * thick), share);
    paint.gloss = 1.0F;
    paint.film = std::max(paint.film, static_cast<float>(share));
  }
}

Paint SurfacePaint::steel(const Eigen::Vector2d& on_blade) {
  static const Pattern kScratches(0.0006, 31);
  const float grey = static_cast<float>(0.50 + 0.04 * kScratches(on_blade.x() * 0.03, on_blade.y()));
  return {cv::Vec3f(grey * 1.03F, grey, grey * 0.97F), 0.0F};
}

}  // namespace cortshift_stereo_phantom
