#include "cortshift_tracking_phantom/seen_surface.hpp"

#include "cortshift_stereo/geometry/point_transform.hpp"
#include "cortshift_stereo/reconstruction.hpp"

namespace cortshift_tracking_phantom {

cortshift_stereo::Surface seenSurface(cortshift_stereo_phantom::PhantomPairs& pairs, int stage) {
  const cortshift_stereo_phantom::PhantomScene& scene = pairs.scene();
  const cortshift_stereo::Rectifier rectifier(scene.stereoHead().model);
  const cortshift_stereo_phantom::StereoImages images = pairs.take(stage, 1);
  cortshift_stereo::Surface surface = cortshift_stereo::reconstruct(images.left, images.right, rectifier).surface_left;
  surface.points = cortshift_stereo::transformPoints(
      scene.view(stage, cortshift_stereo_phantom::Side::kLeft).T_pmr_camera, surface.points);
  return surface;
}

}  // namespace cortshift_tracking_phantom
