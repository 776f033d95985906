// Renders the stages of a phantom case to PNG files, to look at.
#include <memory>
#include <opencv2/imgcodecs.hpp>

#include "cortshift_stereo/command_line.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"

namespace cortshift_stereo {
namespace {

const char* const kHelp =
    R"(render_phantom --case CASE.yaml --output DIR

Render every stage of a phantom case to STAGE_left.png and STAGE_right.png in an existing folder.
Exit: 0 done, 1 failed, 2 bad usage.
)";

void writeImage(const std::string& path, const cv::Mat& image) {
  if (!cv::imwrite(path, image)) throw std::runtime_error("cannot write " + path + "; does the folder exist?");
}

void run(const Options& options) {
  using namespace cortshift_stereo_phantom;
  const std::string folder = options.required("output");
  const auto scene = std::make_shared<const PhantomScene>(loadPhantomCase(options.required("case")));
  PhantomPairs pairs(scene);
  const auto progress = progressBar("rendering");
  for (int stage = 0; stage < scene->stageCount(); ++stage) {
    const StereoImages pair = pairs.take(stage, 0);
    const std::string name = scene->description().stages[static_cast<std::size_t>(stage)].name;
    writeImage(folder + "/" + name + "_left.png", pair.left);
    writeImage(folder + "/" + name + "_right.png", pair.right);
    if (progress) progress((stage + 1.0) / scene->stageCount());
  }
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  return cortshift_stereo::runTool(argc, argv, cortshift_stereo::kHelp, {"case", "output"}, cortshift_stereo::run);
}
