// What PhantomScene keeps of a stage for its many evaluations.
#pragma once

#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace cortshift_stereo_phantom {

struct PhantomScene::Stage {
  struct Variation {
    double kx, ky, phase;
  };

  Eigen::Vector3d shift = Eigen::Vector3d::Zero();  // sag and lateral, brain frame [m]
  DeformationSettings deformation;
  std::array<Variation, 3> variation{};
  std::optional<Outline> hole;
  HoleSettings hole_settings;
  std::vector<Outline> blood;
};

}  // namespace cortshift_stereo_phantom
