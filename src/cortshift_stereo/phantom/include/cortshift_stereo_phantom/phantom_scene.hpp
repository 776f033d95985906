// The phantom's head as an analytic surface: every material point at every stage, exactly.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_flow_phantom/cortical_texture.hpp"
#include "cortshift_flow_phantom/plane_waves.hpp"
#include "cortshift_stereo_phantom/phantom_cameras.hpp"
#include "cortshift_stereo_phantom/phantom_case.hpp"

namespace cortshift_stereo_phantom {

/// What a surface point consists of; kRetractor stands for every instrument.
enum class Material : unsigned char { kNone = 0, kBrain = 1, kRim = 2, kBlood = 3, kHole = 4, kRetractor = 5 };

/// A value of material coordinates with its gradient.
struct ScalarField {
  double value;
  double dx, dy;  ///< [1/m]
};

/// Normalised radius about a centre: 0 in the middle, 1 on a smooth closed outline, about linear between.
class Outline {
 public:
  explicit Outline(const OutlineSettings& settings);
  ScalarField radius(double x, double y) const;
  double smallestHalfAxis() const { return smallest_half_axis_; }  ///< [m]

 private:
  Eigen::Vector2d centre_, inverse_square_;
  double smallest_half_axis_;
  double amplitude_;
  cortshift_flow_phantom::PlaneWaves<5> waves_;
};

/// A surface point and its tangents along the material coordinates, in the brain frame.
struct SurfaceSample {
  Eigen::Vector3d point;                  ///< [m]
  Eigen::Vector3d along_x;                ///< d point / dx
  Eigen::Vector3d along_y;                ///< d point / dy
  ScalarField rim;                        ///< Outline::radius of the craniotomy: below 1 inside
  cortshift_flow_phantom::Relief relief;  ///< gyral relief of the brain [m]; 0 outside
};

/// Where a ray meets the scene.
struct RayHit {
  double distance;            ///< along the ray, in lengths of its direction
  Eigen::Vector2d material;   ///< material coordinates [m]; NaN on the retractor
  Eigen::Vector3d point_pmr;  ///< [m]
  Material what;
};

/// Where a ray meets an instrument (brain frame).
struct InstrumentHit {
  double distance;             ///< along the ray, in lengths of its direction
  Eigen::Vector2d on_surface;  ///< along and across the instrument [m]
  Eigen::Vector3d normal;
};

class RippledFilm;
class TissuePicture;

/// A material point next to some point of space.
struct NearestPoint {
  Eigen::Vector2d material;  ///< [m]
  double distance;           ///< from the given point to the surface [m], positive outside the head
};

/// Geometry of a case. Stages are named by their index in the case; kUndeformed is the head before any shift.
class PhantomScene {
 public:
  static constexpr int kUndeformed = -1;

  /// @throws PhantomCaseError where a value is out of range or a stage folds the surface over itself.
  explicit PhantomScene(const PhantomCase& description);
  ~PhantomScene();
  PhantomScene(PhantomScene&&) noexcept;

  const PhantomCase& description() const { return case_; }
  /// At the reference setting: what a stereo calibration there would find.
  const StereoHead& stereoHead() const { return head_; }
  /// At the settings of a stage.
  StereoHead headOf(int stage) const;
  const cortshift_flow_phantom::CorticalTexture& texture() const { return *texture_; }
  const TissuePicture* picture() const { return picture_.get(); }  ///< null: painted cortex
  const RippledFilm* film() const { return film_.get(); }          ///< null: no film

  /// Index of a stage by name. @throws PhantomCaseError listing the names there are.
  int stageIndex(const std::string& name) const;
  int stageCount() const { return static_cast<int>(case_.stages.size()); }

  // Poses of a stage.
  Eigen::Isometry3d T_pmr_head(int stage) const;
  Eigen::Isometry3d T_reference_microscope(int stage) const;
  /// The raw image at the settings of the stage.
  View view(int stage, Side side) const { return rawView(headOf(stage), case_.light, side, T_pmr_head(stage)); }
  /// What rectification makes of it: always that of the reference setting.
  View rectified(int stage, Side side) const { return rectifiedView(head_, case_.light, side, T_pmr_head(stage)); }

  // Truth.
  SurfaceSample sample(int stage, double x, double y) const;
  Eigen::Vector3d pointAt(int stage, double x, double y) const;              ///< in pmr [m]
  Eigen::Vector3d normalAt(int stage, double x, double y) const;             ///< in pmr, outwards, unit length
  Eigen::Vector3d displacement(int from, int to, double x, double y) const;  ///< in pmr [m]
  Material materialAt(int stage, double x, double y) const;

  /// Distance [m] inwards from the rim of the craniotomy, to first order; negative outside.
  double rimDistance(double x, double y) const { return rimDistance(craniotomy_.radius(x, y)); }
  double rimDistance(const ScalarField& rim) const;
  /// Whether that is surely more than `distance`; costs no root.
  bool isInside(const ScalarField& rim, double distance) const;

  /// The surface point of a stage nearest to `point_pmr` (within about 3 mm of the surface), by damped Gauss-Newton.
  /// Nothing where no surface is near.
  std::optional<NearestPoint> materialOf(const Eigen::Vector3d& point_pmr, int stage) const;

  /// First hit of a ray with surface or retractor: marching with bisection, slow (about 1 ms) and independent of the
  /// renderer's Newton iteration. Accurate to 1e-9 m.
  std::optional<RayHit> castRay(int stage, const Eigen::Vector3d& origin_pmr,
                                const Eigen::Vector3d& direction_pmr) const;

  /// Whether a view sees the material point: inside the image and the first hit of its ray.
  bool isVisible(int stage, double x, double y, const View& view) const;

  /// Nearest hit of a ray (brain frame) with the stage's instruments.
  std::optional<InstrumentHit> hitInstrument(int stage, const Eigen::Vector3d& origin_brain,
                                             const Eigen::Vector3d& direction) const;

  /// Share of the lamp's light that the rods of a stage let through to a point (brain frame).
  double lightPast(int stage, const Eigen::Vector3d& point_brain, const Eigen::Vector3d& lamp_brain) const;

 private:
  friend class SurfacePaint;
  struct Stage;

  SurfaceSample undeformed(double x, double y) const;
  void checkFolds(int stage) const;
  std::optional<Eigen::Vector2d> materialBelow(int stage, const Eigen::Vector3d& point_brain,
                                               const Eigen::Vector2d& guess) const;

  PhantomCase case_;
  StereoHead head_;
  Eigen::Isometry3d T_brain_pmr_;
  Eigen::Vector3d gravity_brain_;
  std::shared_ptr<const cortshift_flow_phantom::CorticalTexture> texture_;
  std::shared_ptr<const TissuePicture> picture_;
  std::shared_ptr<const RippledFilm> film_;
  Outline craniotomy_;
  std::vector<Stage> stages_;
};

}  // namespace cortshift_stereo_phantom
