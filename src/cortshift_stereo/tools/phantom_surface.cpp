// Writes the exact surface of a phantom stage as the left camera sees it: what a faultless reconstruction would give.
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <vector>

#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace {

constexpr const char* kUsage =
    "usage: phantom_surface CASE.yaml STAGE OUT.pcd\n"
    "Writes the exact surface behind every pixel of the rectified left image, with the image's noisy colour, as an "
    "organised\n"
    "binary PCD: x y z [m] in pmr, rgb; NaN where nothing is seen.\n";

void writeSurface(const std::string& case_path, const std::string& stage_name, const std::string& path) {
  using namespace cortshift_stereo_phantom;
  const PhantomScene scene(loadPhantomCase(case_path));
  const int stage = scene.stageIndex(stage_name);
  const View view = scene.rectified(stage, Side::kLeft);
  const ViewTruth truth = truthOf(scene, stage, view);
  const ImageSettings& image = scene.description().image;
  const cv::Mat colour = Sensor(image.noise, image.noise_seed)
                             .expose(Sensor::prepare(renderView(scene, stage, view, image.supersampling)),
                                     static_cast<std::uint64_t>(stage), Side::kLeft);
  struct Point {
    float x, y, z;
    std::uint32_t rgb;
  };
  std::vector<Point> points;
  points.reserve(static_cast<std::size_t>(view.size.area()));
  for (int row = 0; row < view.size.height; ++row)
    for (int column = 0; column < view.size.width; ++column) {
      const cv::Vec3d& p = truth.points_pmr.at<cv::Vec3d>(row, column);
      const cv::Vec3b& c = colour.at<cv::Vec3b>(row, column);
      points.push_back({static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2]),
                        static_cast<std::uint32_t>(c[2]) << 16 | static_cast<std::uint32_t>(c[1]) << 8 | c[0]});
    }
  std::ofstream file(path, std::ios::binary);
  file << "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH " << view.size.width
       << "\nHEIGHT " << view.size.height << "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << points.size() << "\nDATA binary\n";
  file.write(reinterpret_cast<const char*>(points.data()), static_cast<std::streamsize>(points.size() * sizeof(Point)));
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path + "; is the folder there, is the disk full?");
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
    writeSurface(argv[1], argv[2], argv[3]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "phantom_surface: %s\n", error.what());
    return 1;
  }
  return 0;
}
