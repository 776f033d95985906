// One stereo pair to a textured cloud.
#include <cstdio>
#include <opencv2/core/utility.hpp>

#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/command_line.hpp"
#include "cortshift_stereo/geometry/surface_file.hpp"
#include "cortshift_stereo/images/bit_depth.hpp"
#include "cortshift_stereo/reconstruction_limits.hpp"

namespace cortshift_stereo {
namespace {

const char* const kHelp =
    R"(reconstruct_pair LEFT RIGHT --left-info left.yaml --right-info right.yaml --output cloud.ply
                 [--disparity D.pfm] [--threads N] [--image-bits N] [limits]

Reconstruct the surface that one stereo pair shows, as a textured cloud in the raw left camera frame, in metres.

  LEFT RIGHT                  raw images (png, jpg, tif, bmp, pgm, ppm)
  --left-info F               ROS camera_info YAML of the left camera, and
  --right-info F              of the right one (P[3] = -fx * baseline)
  --output F                  binary PLY: x y z [m], red green blue, confidence 0...1
  --disparity F               disparity of the rectified left image [px] as PFM; NaN where invalid
  --threads N                 worker threads (default: all)
  --image-bits N              bits that 16-bit images use (10, 12, 14 ...); default 0: recognised from the values

Limits, as the parameters of surface_reconstruction:
)";

const char* const kHelpEnd =
    R"(
A pair that cannot be trusted (blank, saturated, out of focus, swapped, mismatched) is refused with the reason.
Exit: 0 done, 1 failed, 2 bad usage.
)";

std::string help() {
  std::string text = kHelp;
  ReconstructionSettings settings;
  for (const ReconstructionLimit& limit : reconstructionLimits()) {
    char line[200];
    std::snprintf(line, sizeof line, "  --%-25s %s (default %g, allowed %g ... %g)\n", (limit.option() + " X").c_str(),
                  limit.meaning.c_str(), limit.in(settings), limit.low, limit.high);
    text += line;
  }
  return text + kHelpEnd;
}

ReconstructionSettings settingsOf(const Options& options) {
  ReconstructionSettings settings;
  for (const ReconstructionLimit& limit : reconstructionLimits()) {
    double& value = limit.in(settings);
    value = options.number(limit.option(), value);
    if (!(value >= limit.low && value <= limit.high)) {
      char range[80];
      std::snprintf(range, sizeof range, " %g is not allowed; allowed is %g ... %g", value, limit.low, limit.high);
      throw UsageError("--" + limit.option() + range);
    }
  }
  try {
    settings.validate();
  } catch (const std::invalid_argument& error) {
    throw UsageError(error.what());
  }
  return settings;
}

void run(const Options& options) {
  const ReconstructionSettings settings = settingsOf(options);
  const double threads = options.number("threads", 0);
  if (threads < 0 || threads > 1024 || threads != static_cast<int>(threads))
    throw UsageError("--threads must be a whole number, 0 (all) ... 1024");
  const double bits = options.number("image-bits", 0);
  if (bits != 0 && (bits < 8 || bits > 16 || bits != static_cast<int>(bits)))
    throw UsageError("--image-bits must be a whole number, 8 ... 16, or 0 to recognise it");
  const std::string output = options.required("output");
  const std::string left_info = options.required("left-info"), right_info = options.required("right-info");
  if (threads > 0) cv::setNumThreads(static_cast<int>(threads));

  const Rectifier rectifier(readStereoModelYaml(left_info, right_info));
  cv::Mat left = bgrOf(readImageFile(options.required("LEFT")));
  cv::Mat right = bgrOf(readImageFile(options.required("RIGHT")));
  BitDepth(static_cast<int>(bits)).toEightBits(left, right);
  const ReconstructionResult result = reconstruct(left, right, rectifier, settings);
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
  std::set<std::string> known{"left-info", "right-info", "output", "disparity", "threads", "image-bits"};
  for (const ReconstructionLimit& limit : reconstructionLimits()) known.insert(limit.option());
  return runTool(argc, argv, help(), known, run, {"LEFT", "RIGHT"});
}
