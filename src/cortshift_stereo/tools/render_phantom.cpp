// Renders the stages of a phantom case to PNG files, to look at.
#include <chrono>
#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>
#include <opencv2/imgcodecs.hpp>

#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace {

constexpr const char* kUsage =
    "usage: render_phantom CASE.yaml OUTPUT_DIR\n"
    "Writes STAGE_left.png and STAGE_right.png of every stage of a phantom case into an existing folder.\n";

void writeImage(const std::string& path, const cv::Mat& image) {
  if (!cv::imwrite(path, image)) throw std::runtime_error("cannot write " + path + "; does the folder exist?");
}

void render(const std::string& case_path, const std::string& folder) {
  using namespace cortshift_stereo_phantom;
  const auto scene = std::make_shared<const PhantomScene>(loadPhantomCase(case_path));
  PhantomPairs pairs(scene);
  for (int stage = 0; stage < scene->stageCount(); ++stage) {
    const auto start = std::chrono::steady_clock::now();
    const StereoImages pair = pairs.take(stage, 0);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    const std::string name = scene->description().stages[static_cast<std::size_t>(stage)].name;
    writeImage(folder + "/" + name + "_left.png", pair.left);
    writeImage(folder + "/" + name + "_right.png", pair.right);
    std::printf("%s: %.2f s\n", name.c_str(), seconds.count());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "--help") == 0) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  if (argc != 3) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    render(argv[1], argv[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "render_phantom: %s\n", error.what());
    return 1;
  }
  return 0;
}
