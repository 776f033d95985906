// One stereo pair to a textured cloud.
#include <cstdio>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>

#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/command_line.hpp"
#include "cortshift_stereo/geometry/surface_file.hpp"
#include "cortshift_stereo/reconstruction.hpp"

namespace cortshift_stereo {
namespace {

const char* const kHelp =
    R"(reconstruct_pair LEFT RIGHT --left-info left.yaml --right-info right.yaml --output cloud.ply
                 [--disparity D.pfm] [--threads N] [--min-working-distance Z] [--max-working-distance Z]

Reconstruct the surface that one stereo pair shows, as a textured cloud in the raw left camera frame, in metres.

  LEFT RIGHT                  raw images (png, jpg, tif, bmp, pgm, ppm)
  --left-info F               ROS camera_info YAML of the left camera, and
  --right-info F              of the right one (P[3] = -fx * baseline)
  --output F                  binary PLY: x y z [m], red green blue, confidence 0...1
  --disparity F               disparity of the rectified left image [px] as PFM; NaN where invalid
  --threads N                 worker threads (default: all)
  --min-working-distance Z    nearest surface along the optical axis [m] (default 0.15)
  --max-working-distance Z    farthest one [m] (default 0.6)

A pair that cannot be trusted (blank, saturated, out of focus, swapped, mismatched) is refused with the reason.
Exit: 0 done, 1 failed, 2 bad usage.
)";

cv::Mat readImage(const std::string& path) {
  const cv::Mat image = cv::imread(path, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  if (image.empty()) throw std::runtime_error("cannot read the image " + path);
  return image;
}

void run(const Options& options) {
  ReconstructionSettings settings;
  settings.min_working_distance = options.number("min-working-distance", settings.min_working_distance);
  settings.max_working_distance = options.number("max-working-distance", settings.max_working_distance);
  const double threads = options.number("threads", 0);
  if (threads < 0 || threads > 1024 || threads != static_cast<int>(threads))
    throw UsageError("--threads must be a whole number, 0 (all) ... 1024");
  try {
    settings.validate();
  } catch (const std::invalid_argument& error) {
    throw UsageError(error.what());
  }
  const std::string output = options.required("output");
  const std::string left_info = options.required("left-info"), right_info = options.required("right-info");
  if (threads > 0) cv::setNumThreads(static_cast<int>(threads));

  const Rectifier rectifier(readStereoModelYaml(left_info, right_info));
  const ReconstructionResult result =
      reconstruct(readImage(options.required("LEFT")), readImage(options.required("RIGHT")), rectifier, settings);
  writePly(output, result.surface_left);
  if (const auto disparity = options.find("disparity")) writePfm(*disparity, result.disparity);
  const ReconstructionQuality& quality = result.quality;
  std::printf("reconstruct_seconds: %.4f\n", result.seconds);
  std::printf("coverage: %.4f\n", quality.coverage);
  std::printf("search_range: %d ... %d px\n", quality.search_range.start, quality.search_range.end);
  std::printf("epipolar_residual: %.3f px over %d points\n", quality.epipolar.spread, quality.epipolar.matched);
  for (const std::string& warning : result.warnings) std::printf("warning: %s\n", warning.c_str());
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  using namespace cortshift_stereo;
  return runTool(
      argc, argv, kHelp,
      {"left-info", "right-info", "output", "disparity", "threads", "min-working-distance", "max-working-distance"},
      run, {"LEFT", "RIGHT"});
}
