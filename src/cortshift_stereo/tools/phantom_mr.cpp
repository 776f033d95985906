// Writes the preoperative MR that matches a phantom case.
#include "cortshift_stereo_phantom/phantom_mr.hpp"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>

namespace {

constexpr const char* kUsage =
    "usage: phantom_mr CASE.yaml OUT.nii [--voxel MM] [--noise SD] [--side MM] [--tumour LABELS.nii]\n"
    "Writes a T1-weighted NIfTI volume with contrast agent of the case's undeformed head, in pmr (RAS).\n"
    "  --voxel MM   side of a voxel, 0.1 to 2 (default 0.8)\n"
    "  --noise SD   standard deviation of the noise; white matter is 150 (default 2)\n"
    "  --side MM    only a cube of this side around the middle of the craniotomy, 20 to 300\n"
    "  --tumour LABELS.nii  with a tumour of 20 mm, 24 mm below the middle of the craniotomy, and the file of its "
    "voxels\n";
constexpr double kTumourRadius = 0.010;  // [m]

}  // namespace

int main(int argc, char** argv) {
  using namespace cortshift_stereo_phantom;
  if (argc == 2 && std::strcmp(argv[1], "--help") == 0) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  MrSettings settings;
  const char* tumour = nullptr;
  bool usable = argc >= 3 && argc % 2 == 1;
  for (int i = 3; usable && i < argc; i += 2) {
    if (std::strcmp(argv[i], "--tumour") == 0) {
      tumour = argv[i + 1];
      settings.tumour = kTumourRadius;
      continue;
    }
    char* end = nullptr;
    const double value = std::strtod(argv[i + 1], &end);
    usable = end != argv[i + 1] && *end == '\0';
    if (std::strcmp(argv[i], "--voxel") == 0)
      settings.voxel = value / 1000;
    else if (std::strcmp(argv[i], "--noise") == 0)
      settings.noise = value;
    else if (std::strcmp(argv[i], "--side") == 0)
      settings.side = value / 1000;
    else
      usable = false;
  }
  if (!usable) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    const PhantomScene scene(loadPhantomCase(argv[1]));
    writeNifti(makeMr(scene, settings), argv[2]);
    if (tumour) writeNifti(makeTumour(scene, settings), tumour);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "phantom_mr: %s\n", error.what());
    return 1;
  }
  return 0;
}
