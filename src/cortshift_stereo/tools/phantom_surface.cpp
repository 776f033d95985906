// Writes the surface of a phantom stage as the left camera sees it: the exact one, or what stereo makes of the images.
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_stereo/geometry/point_transform.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace {

using namespace cortshift_stereo_phantom;

constexpr const char* kUsage =
    "usage: phantom_surface CASE.yaml STAGE OUT.pcd [--reconstructed]\n"
    "Writes the exact surface behind every pixel of the rectified left image, with the image's noisy colour, as an "
    "organised\n"
    "binary PCD: x y z [m] in pmr, rgb, confidence; NaN where nothing is seen.\n"
    "  --reconstructed   what stereo makes of the stage's pair of images, in place of the exact surface\n";

struct ColouredPoints {
  cv::Mat points_pmr;  ///< CV_32FC3 [m]
  cv::Mat colour;      ///< CV_8UC3, BGR
  cv::Mat confidence;  ///< CV_32F, 0 to 1
};

ColouredPoints exact(const PhantomScene& scene, int stage) {
  const View view = scene.rectified(stage, Side::kLeft);
  const ImageSettings& image = scene.description().image;
  ColouredPoints surface;
  truthOf(scene, stage, view).points_pmr.convertTo(surface.points_pmr, CV_32F);
  surface.colour = Sensor(image).expose(Sensor::prepare(renderView(scene, stage, view, image.supersampling)),
                                        static_cast<std::uint64_t>(stage), Side::kLeft);
  surface.confidence = cv::Mat1f(surface.points_pmr.size(), 1.f);
  return surface;
}

ColouredPoints reconstructed(const std::shared_ptr<const PhantomScene>& scene, int stage) {
  const StereoImages images = PhantomPairs(scene).take(stage, 1);
  const cortshift_stereo::Rectifier rectifier(scene->stereoHead().model);
  const auto surface = cortshift_stereo::reconstruct(images.left, images.right, rectifier).surface_left;
  return {cortshift_stereo::transformPoints(scene->view(stage, Side::kLeft).T_pmr_camera, surface.points),
          surface.colour, surface.confidence};
}

void writeSurface(const std::string& case_path, const std::string& stage_name, const std::string& path,
                  bool from_images) {
  const auto scene = std::make_shared<const PhantomScene>(loadPhantomCase(case_path));
  const int stage = scene->stageIndex(stage_name);
  const ColouredPoints surface = from_images ? reconstructed(scene, stage) : exact(*scene, stage);
  const cv::Size size = surface.points_pmr.size();
  struct Point {
    float x, y, z;
    std::uint32_t rgb;
    float confidence;
  };
  std::vector<Point> points;
  points.reserve(static_cast<std::size_t>(size.area()));
  for (int row = 0; row < size.height; ++row)
    for (int column = 0; column < size.width; ++column) {
      const cv::Vec3f& p = surface.points_pmr.at<cv::Vec3f>(row, column);
      const cv::Vec3b& c = surface.colour.at<cv::Vec3b>(row, column);
      points.push_back({p[0], p[1], p[2],
                        static_cast<std::uint32_t>(c[2]) << 16 | static_cast<std::uint32_t>(c[1]) << 8 | c[0],
                        surface.confidence.at<float>(row, column)});
    }
  std::ofstream file(path, std::ios::binary);
  file << "VERSION 0.7\nFIELDS x y z rgb confidence\nSIZE 4 4 4 4 4\nTYPE F F F U F\nCOUNT 1 1 1 1 1\nWIDTH "
       << size.width << "\nHEIGHT " << size.height << "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << points.size()
       << "\nDATA binary\n";
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
  const bool from_images = argc == 5 && std::strcmp(argv[4], "--reconstructed") == 0;
  if (argc != 4 && !from_images) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    writeSurface(argv[1], argv[2], argv[3], from_images);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "phantom_surface: %s\n", error.what());
    return 1;
  }
  return 0;
}
