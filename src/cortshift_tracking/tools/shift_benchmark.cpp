// Accuracy and time of the shift between the stages of a phantom case, from rendered pairs or from exact surfaces.
#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/point_transform.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "cortshift_tracking/closure.hpp"
#include "cortshift_tracking/pictures.hpp"
#include "cortshift_tracking/shift.hpp"
#include "cortshift_tracking_phantom/field_truth.hpp"

namespace {

using namespace cortshift_stereo_phantom;
using namespace cortshift_tracking;

constexpr const char* kUsage =
    "usage: shift_benchmark CASE.yaml [--exact] [--resolution M] [--ungated] [--threads N] [--repeat N] [--pictures "
    "DIR]\n"
    "Every stage of a phantom case against the ones after it: 3D error [mm], coverage, seconds of each step, memory.\n"
    "  --exact         exact surfaces in place of reconstructed ones: the error of tracking alone\n"
    "  --resolution M  of the projection grid [m], 0.0001 if not given\n"
    "  --ungated       report vectors of any confidence but 0\n"
    "  --threads N     0: all\n"
    "  --repeat N      the least of N runs counts for the times\n"
    "  --pictures DIR  writes FROM__TO_{before,after,magnitude}.png\n"
    "Exit status: 0 done, 1 failed, 2 bad usage.\n";

struct Options {
  std::string case_path, pictures;
  bool exact = false;
  int repeat = 1;
  ShiftSettings shift;
};

bool parse(int argc, char** argv, Options& out) {
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name == "--exact") {
      out.exact = true;
    } else if (name == "--ungated") {
      out.shift.inversion.min_confidence = 0;
    } else if (name.compare(0, 2, "--") == 0) {
      if (++i == argc) return false;
      if (name == "--resolution")
        out.shift.frame.resolution = std::atof(argv[i]);
      else if (name == "--threads")
        out.shift.setThreads(std::atoi(argv[i]));
      else if (name == "--repeat")
        out.repeat = std::max(1, std::atoi(argv[i]));
      else if (name == "--pictures")
        out.pictures = argv[i];
      else
        return false;
    } else if (out.case_path.empty()) {
      out.case_path = name;
    } else {
      return false;
    }
  }
  return !out.case_path.empty();
}

cortshift_stereo::Surface seen(PhantomPairs& pairs, int stage, bool exact) {
  const PhantomScene& scene = pairs.scene();
  const cortshift_stereo::Rectifier rectifier(scene.stereoHead().model);
  const StereoImages images = pairs.take(stage, 1);
  if (!exact) {
    auto result = cortshift_stereo::reconstruct(images.left, images.right, rectifier);
    result.surface_left.points =
        cortshift_stereo::transformPoints(scene.view(stage, Side::kLeft).T_pmr_camera, result.surface_left.points);
    return result.surface_left;
  }
  cortshift_stereo::Surface surface;
  surface.colour = rectifier.rectify(images.left, images.right).left_colour;
  truthOf(scene, stage, scene.rectified(stage, Side::kLeft)).points_pmr.convertTo(surface.points, CV_32F);
  surface.confidence = cv::Mat(surface.points.size(), CV_32FC1, cv::Scalar(1));
  return surface;
}

void run(const Options& options) {
  const auto scene = std::make_shared<const PhantomScene>(loadPhantomCase(options.case_path));
  PhantomPairs pairs(scene);
  std::vector<cortshift_stereo::Surface> surfaces;
  for (int stage = 0; stage < scene->stageCount(); ++stage) surfaces.push_back(seen(pairs, stage, options.exact));
  const Directions directions{averageNormal(surfaces[0]), scene->description().gravity_pmr};
  std::printf("%-32s | error mm: median  95 %%    max | cover | |d| mm       | s: projection flow inversion\n", "pair");
  std::vector<DisplacementField> consecutive;
  DisplacementField direct;
  for (int from = 0; from < scene->stageCount(); ++from)
    for (int to = from + 1; to < scene->stageCount(); ++to) {
      const auto name = [&](int stage) { return scene->description().stages[static_cast<std::size_t>(stage)].name; };
      const auto at = [&](int stage) { return surfaces[static_cast<std::size_t>(stage)]; };
      ShiftResult result;
      double projection = 1e9, flow = 1e9, inversion = 1e9;
      for (int i = 0; i < options.repeat; ++i) {
        result = computeShift(at(from), at(to), directions, options.shift);
        projection = std::min(projection, result.summary.projection_seconds);
        flow = std::min(flow, result.summary.flow_seconds);
        inversion = std::min(inversion, result.summary.inversion_seconds);
      }
      if (to == from + 1) consecutive.push_back(result.field);
      if (from == 0) direct = result.field;
      const auto error = cortshift_tracking_phantom::compareWithTruth(result.field, *scene, from, to);
      std::printf("%-32s |       %8.4f %7.4f %7.3f | %4.1f%% | %5.2f +- %5.2f | %.3f %.3f %.3f%s\n",
                  (name(from) + " -> " + name(to)).c_str(), 1e3 * error.median, 1e3 * error.p95, 1e3 * error.largest,
                  1e2 * error.coverage, 1e3 * result.summary.magnitude.mean, 1e3 * result.summary.magnitude.sd,
                  projection, flow, inversion,
                  error.foreign_points == 0 ? "" : (" foreign " + std::to_string(error.foreign_points)).c_str());
      std::fflush(stdout);
      if (options.pictures.empty()) continue;
      const std::string base = options.pictures + "/" + name(from) + "__" + name(to);
      cv::imwrite(base + "_before.png", overlayBefore(result));
      cv::imwrite(base + "_after.png", overlayAfter(result));
      cv::imwrite(base + "_magnitude.png", magnitudeMap(result));
    }
  if (consecutive.size() > 1) {
    const Closure closure = closureOf(consecutive, direct);
    std::printf("closure of the consecutive shifts against first -> last: median %.4f mm, 95 %% %.4f mm, %zu points\n",
                1e3 * closure.median, 1e3 * closure.p95, closure.points);
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf("peak memory %.0f MB, all stages and the phantom included\n", usage.ru_maxrss / 1024.0);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && (std::strcmp(argv[1], "--help") == 0 || std::strcmp(argv[1], "-h") == 0)) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  Options options;
  if (!parse(argc, argv, options)) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    run(options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "shift_benchmark: %s\n", error.what());
    return 1;
  }
  return 0;
}
