// Answers where points of one stage of a phantom case have gone at another.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <limits>
#include <sstream>
#include <string>

#include "cortshift_stereo_phantom/phantom_scene.hpp"

namespace {

constexpr const char* kUsage =
    "usage: phantom_truth CASE.yaml FROM TO < POINTS.csv\n"
    "Reads points x,y,z in pmr [m] near the surface of stage FROM, one a line, and prints for each: material "
    "coordinates\n"
    "x_m,y_m, distance_m from that surface (positive outside), rim_m inwards from the rim of the craniotomy, and the "
    "true\n"
    "displacement dx_m,dy_m,dz_m to stage TO in pmr. nan where no surface is near. The head before any shift is "
    "`undeformed`.\n";

int stageOf(const cortshift_stereo_phantom::PhantomScene& scene, const std::string& name) {
  return name == "undeformed" ? cortshift_stereo_phantom::PhantomScene::kUndeformed : scene.stageIndex(name);
}

void answer(const std::string& case_path, const std::string& from_name, const std::string& to_name) {
  using namespace cortshift_stereo_phantom;
  const PhantomScene scene(loadPhantomCase(case_path));
  const int from = stageOf(scene, from_name), to = stageOf(scene, to_name);
  std::puts("x_m,y_m,distance_m,rim_m,dx_m,dy_m,dz_m");
  char line[512];
  while (std::fgets(line, sizeof line, stdin)) {
    double x, y, z;
    if (std::sscanf(line, "%lf,%lf,%lf", &x, &y, &z) != 3) throw std::runtime_error(std::string("not x,y,z: ") + line);
    const auto near = scene.materialOf({x, y, z}, from);
    const double none = std::numeric_limits<double>::quiet_NaN();
    const Eigen::Vector2d m = near ? near->material : Eigen::Vector2d(none, none);
    const Eigen::Vector3d d = near ? scene.displacement(from, to, m.x(), m.y()) : Eigen::Vector3d(none, none, none);
    std::printf("%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", m.x(), m.y(), near ? near->distance : none,
                near ? scene.rimDistance(m.x(), m.y()) : none, d.x(), d.y(), d.z());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "--help") == 0) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  if (argc != 4) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    answer(argv[1], argv[2], argv[3]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "phantom_truth: %s\n", error.what());
    return 1;
  }
  return 0;
}
