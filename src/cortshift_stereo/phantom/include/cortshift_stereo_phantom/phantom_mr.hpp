// A synthetic preoperative MR of the phantom's head before any shift.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace cortshift_stereo_phantom {

struct MrSettings {
  double voxel = 0.0008;   ///< side of a voxel [m], 0.0001 ... 0.002
  int supersampling = 4;   ///< samples per voxel side near tissue borders, 1 ... 8
  double noise = 2.0;      ///< standard deviation of the intensity noise (white matter is 150)
  double side = 0;         ///< of a cube around the middle of the craniotomy [m], 0.02 ... 0.3; 0: the whole head
  std::uint32_t seed = 1;  ///< of the noise
  double tumour =
      0;  ///< radius of a tumour whose middle is 24 mm below that of the craniotomy [m], 0.003 ... 0.015; 0: none

  /// @throws PhantomCaseError naming the setting, its value and the allowed range.
  void validate() const;
};

/// T1-weighted with contrast agent: air 2, skull 18, CSF 25, tumour 60 with a rim of 210, dura 70, grey matter 100,
/// white matter 150, fat 190, vessels 255. Each voxel is the mean over its cube, as a scanner's partial volume.
struct MrVolume {
  std::array<int, 3> size;  ///< voxels along i, j, k; i runs fastest
  std::vector<std::int16_t> data;
  Eigen::Affine3d T_pmr_voxel;  ///< voxel index to pmr [m]; i towards the left, as radiological files have it
};

/// The undeformed head. Inside the craniotomy its cortex is the surface PhantomScene::sample(kUndeformed, ...) exactly;
/// around it skull and scalp close over the brain, a ball of the dome's radius beyond.
/// @throws PhantomCaseError for settings that are not allowed, or would make a volume of more than a gigabyte
MrVolume makeMr(const PhantomScene& scene, const MrSettings& settings = {});

/// Labels on the grid of makeMr: 1 in the tumour, else 0. @throws as makeMr
MrVolume makeTumour(const PhantomScene& scene, const MrSettings& settings);

/// NIfTI-1, one file, int16, mm, RAS, sform and qform with scanner code. @throws std::runtime_error
void writeNifti(const MrVolume& volume, const std::string& path);

}  // namespace cortshift_stereo_phantom
