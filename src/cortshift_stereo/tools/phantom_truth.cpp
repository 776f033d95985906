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
    "usage: phantom_truth CASE.yaml FROM TO [--material] < POINTS.csv\n"
    "Reads points x,y,z in pmr [m] near the surface of stage FROM, one a line, and prints for each: material "
    "coordinates\n"
    "x_m,y_m, distance_m from that surface (positive outside), rim_m inwards from the rim of the craniotomy, and the "
    "true\n"
    "displacement dx_m,dy_m,dz_m to stage TO in pmr. nan where no surface is near. The head before any shift is "
    "`undeformed`.\n"
    "  --material   reads material coordinates x,y [m] instead, and also prints the point's place px_m,py_m,pz_m at "
    "FROM\n"
    "               in pmr and column_px,row_px in the rectified left image there (nan for `undeformed`)\n";

int stageOf(const cortshift_stereo_phantom::PhantomScene& scene, const std::string& name) {
  return name == "undeformed" ? cortshift_stereo_phantom::PhantomScene::kUndeformed : scene.stageIndex(name);
}

using cortshift_stereo_phantom::PhantomScene;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

void print(const PhantomScene& scene, const Eigen::Vector2d& material, double distance, int from, int to) {
  const Eigen::Vector3d d = std::isfinite(material.x()) ? scene.displacement(from, to, material.x(), material.y())
                                                        : Eigen::Vector3d(kNone, kNone, kNone);
  std::printf("%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g", material.x(), material.y(), distance,
              std::isfinite(material.x()) ? scene.rimDistance(material.x(), material.y()) : kNone, d.x(), d.y(), d.z());
}

void answerPoints(const PhantomScene& scene, int from, int to) {
  std::puts("x_m,y_m,distance_m,rim_m,dx_m,dy_m,dz_m");
  char line[512];
  while (std::fgets(line, sizeof line, stdin)) {
    double x, y, z;
    if (std::sscanf(line, "%lf,%lf,%lf", &x, &y, &z) != 3) throw std::runtime_error(std::string("not x,y,z: ") + line);
    const auto near = scene.materialOf({x, y, z}, from);
    print(scene, near ? near->material : Eigen::Vector2d(kNone, kNone), near ? near->distance : kNone, from, to);
    std::putchar('\n');
  }
}

void answerMaterial(const PhantomScene& scene, int from, int to) {
  std::puts("x_m,y_m,distance_m,rim_m,dx_m,dy_m,dz_m,px_m,py_m,pz_m,column_px,row_px");
  char line[512];
  while (std::fgets(line, sizeof line, stdin)) {
    double x, y;
    if (std::sscanf(line, "%lf,%lf", &x, &y) != 2) throw std::runtime_error(std::string("not x,y: ") + line);
    const Eigen::Vector3d p = scene.pointAt(from, x, y);
    Eigen::Vector2d pixel(kNone, kNone);
    if (from != PhantomScene::kUndeformed)
      pixel = scene.rectified(from, cortshift_stereo_phantom::Side::kLeft).project(p).value_or(pixel);
    print(scene, {x, y}, 0, from, to);
    std::printf(",%.9g,%.9g,%.9g,%.9g,%.9g\n", p.x(), p.y(), p.z(), pixel.x(), pixel.y());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "--help") == 0) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  const bool material = argc == 5 && std::strcmp(argv[4], "--material") == 0;
  if (argc != 4 && !material) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    const PhantomScene scene(cortshift_stereo_phantom::loadPhantomCase(argv[1]));
    const int from = stageOf(scene, argv[2]), to = stageOf(scene, argv[3]);
    if (material)
      answerMaterial(scene, from, to);
    else
      answerPoints(scene, from, to);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "phantom_truth: %s\n", error.what());
    return 1;
  }
  return 0;
}
