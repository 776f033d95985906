// What the phantom's surface looks like at a material point.
#pragma once

#include <opencv2/core.hpp>

#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace cortshift_stereo_phantom {

struct Paint {
  cv::Vec3f colour;  ///< albedo: blue green red, 0...1
  float gloss;       ///< 0 matt ... 1 wet
  float film = 0;    ///< 0: the surface itself ... 1: a liquid that hides its relief
};

class SurfacePaint {
 public:
  SurfacePaint(const PhantomScene& scene, int stage);

  /// @param surface the sample at (x, y), in any frame
  Paint at(double x, double y, const SurfaceSample& surface) const;

  /// Brushed steel at a place on the blade [m].
  static Paint steel(const Eigen::Vector2d& on_blade);

 private:
  cv::Vec3f rim(double x, double y, double outside) const;
  void paintHole(double x, double y, Paint& paint) const;
  void paintBlood(double x, double y, Paint& paint) const;

  const PhantomScene& scene_;
  int stage_;
};

}  // namespace cortshift_stereo_phantom
