// Accuracy and time of the shift between the stages of a phantom case, from rendered pairs or from exact surfaces.
#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cortshift_stereo/rectification/rectifier.hpp"
#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "cortshift_tracking/field/closure.hpp"
#include "cortshift_tracking/field/pictures.hpp"
#include "cortshift_tracking/shift.hpp"
#include "cortshift_tracking_phantom/field_truth.hpp"
#include "cortshift_tracking_phantom/seen_surface.hpp"

namespace {

using namespace cortshift_stereo_phantom;
using namespace cortshift_tracking;

constexpr const char* kUsage =
    "usage: shift_benchmark CASE.yaml [CASE.yaml ...] [--from-first] [--to STAGE] [--head SEED] [--exact]\n"
    "                       [--resolution M] [--channels C] [--threads N] [--repeat N] [--pictures DIR]\n"
    "Every stage of phantom cases against the ones after it, as a Markdown table: 3D error and coverage with the\n"
    "confidence gate and without (gated | ungated), seconds of each step; then closure, how often vectors of some\n"
    "confidence are right, and memory.\n"
    "  --from-first    only the shifts from the first stage of each case\n"
    "  --to STAGE      only the shifts that end at this stage; may stand more than once\n"
    "  --head SEED     another head: other vessels, gyri and tissue (head.seed of each case)\n"
    "  --exact         exact surfaces in place of reconstructed ones: the error of tracking alone\n"
    "  --resolution M  of the projection grid [m], 0.0001 if not given\n"
    "  --channels C    what the flow sees: auto, rgb, green, blue or luminance\n"
    "  --threads N     0: all\n"
    "  --repeat N      the least of N runs counts for the times\n"
    "  --pictures DIR  writes FROM__TO_{before,after,magnitude,gravity,normal,lateral}.png\n"
    "Exit status: 0 done, 1 failed, 2 bad usage.\n";

struct Options {
  std::vector<std::string> case_paths;
  std::string pictures;
  std::vector<std::string> to;  ///< stages; empty: all
  std::optional<std::uint32_t> head;
  bool exact = false, from_first = false;
  int repeat = 1;
  ShiftSettings shift;
};

bool parse(int argc, char** argv, Options& out) {
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name == "--exact") {
      out.exact = true;
    } else if (name == "--from-first") {
      out.from_first = true;
    } else if (name.compare(0, 2, "--") == 0) {
      if (++i == argc) return false;
      if (name == "--resolution")
        out.shift.frame.resolution = std::atof(argv[i]);
      else if (name == "--channels")
        out.shift.matching.channels = argv[i];
      else if (name == "--threads")
        out.shift.setThreads(std::atoi(argv[i]));
      else if (name == "--repeat")
        out.repeat = std::max(1, std::atoi(argv[i]));
      else if (name == "--to")
        out.to.emplace_back(argv[i]);
      else if (name == "--head")
        out.head = static_cast<std::uint32_t>(std::atoi(argv[i]));
      else if (name == "--pictures")
        out.pictures = argv[i];
      else
        return false;
    } else {
      out.case_paths.push_back(name);
    }
  }
  return !out.case_paths.empty();
}

cortshift_stereo::Surface surfaceOf(PhantomPairs& pairs, int stage, bool exact) {
  if (!exact) return cortshift_tracking_phantom::seenSurface(pairs, stage);
  const PhantomScene& scene = pairs.scene();
  const StereoImages images = pairs.take(stage, 1);
  cortshift_stereo::Surface surface;
  surface.colour = cortshift_stereo::Rectifier(scene.stereoHead().model).rectify(images.left, images.right).left_colour;
  truthOf(scene, stage, scene.rectified(stage, Side::kLeft)).points_pmr.convertTo(surface.points, CV_32F);
  surface.confidence = cv::Mat(surface.points.size(), CV_32FC1, cv::Scalar(1));
  return surface;
}

/// Every vector that both surfaces have, whatever its confidence.
DisplacementField ungated(const ShiftResult& result, const InversionSettings& settings) {
  const cv::Mat sure(result.flow.size(), CV_32FC1, cv::Scalar(1));
  return invert(result.field.frame, result.earlier, result.later, result.flow, sure, settings);
}

/// Every vector of any confidence above 0.
DisplacementField evenUnlikely(const ShiftResult& result, const InversionSettings& settings) {
  InversionSettings open = settings;
  open.min_confidence = 0;
  return invert(result.field.frame, result.earlier, result.later, result.flow, result.field.confidence, open);
}

double foreignShare(const cortshift_tracking_phantom::FieldError& error) {
  const auto all = static_cast<double>(error.compared_points + error.foreign_points);
  return all > 0 ? static_cast<double>(error.foreign_points) / all : 0.0;
}

ShiftResult timed(const cortshift_stereo::Surface& from, const cortshift_stereo::Surface& to,
                  const Directions& directions, const Options& options) {
  ShiftResult result;
  double projection = 1e9, flow = 1e9, inversion = 1e9;
  for (int i = 0; i < options.repeat; ++i) {
    result = computeShift(from, to, directions, options.shift);
    projection = std::min(projection, result.summary.projection_seconds);
    flow = std::min(flow, result.summary.flow_seconds);
    inversion = std::min(inversion, result.summary.inversion_seconds);
  }
  result.summary.projection_seconds = projection;
  result.summary.flow_seconds = flow;
  result.summary.inversion_seconds = inversion;
  return result;
}

void writePictures(const ShiftResult& result, const Directions& directions, const std::string& base) {
  cv::imwrite(base + "_before.png", overlayBefore(result));
  cv::imwrite(base + "_after.png", overlayAfter(result));
  cv::imwrite(base + "_magnitude.png", magnitudeMap(result.field));
  if (directions.gravity_pmr) cv::imwrite(base + "_gravity.png", gravityMap(result.field, *directions.gravity_pmr));
  cv::imwrite(base + "_normal.png", normalMap(result.field, directions.first_normal_pmr));
  cv::imwrite(base + "_lateral.png", lateralMap(result.field, directions.first_normal_pmr));
}

/// The case, named after what the options change of it.
PhantomCase caseOf(const std::string& path, const Options& options) {
  PhantomCase description = loadPhantomCase(path);
  if (options.head) {
    description.head.seed = *options.head;
    description.name += " (head " + std::to_string(*options.head) + ")";
  }
  if (options.exact) description.name += " (exact surfaces)";
  if (options.shift.frame.resolution != ShiftSettings().frame.resolution)
    description.name += cv::format(" (%g mm grid)", 1e3 * options.shift.frame.resolution);
  return description;
}

cortshift_tracking_phantom::Reliability run(const std::string& case_path, const Options& options) {
  using cortshift_tracking_phantom::compareWithTruth;
  const auto scene = std::make_shared<const PhantomScene>(caseOf(case_path, options));
  PhantomPairs pairs(scene);
  const auto wanted = [&](int stage) {
    const std::string& name = scene->description().stages[static_cast<std::size_t>(stage)].name;
    return options.to.empty() || std::find(options.to.begin(), options.to.end(), name) != options.to.end();
  };
  std::vector<cortshift_stereo::Surface> surfaces(static_cast<std::size_t>(scene->stageCount()));
  for (int stage = 0; stage < scene->stageCount(); ++stage)
    if (stage == 0 || !options.from_first || wanted(stage))
      surfaces[static_cast<std::size_t>(stage)] = surfaceOf(pairs, stage, options.exact);
  const Directions directions{averageNormal(surfaces[0]), scene->description().gravity_pmr};
  std::vector<DisplacementField> consecutive;
  DisplacementField direct;
  cortshift_tracking_phantom::Reliability reliability;
  for (int from = 0; from < (options.from_first ? 1 : scene->stageCount()); ++from)
    for (int to = from + 1; to < scene->stageCount(); ++to) {
      if (!wanted(to)) continue;
      const auto name = [&](int stage) { return scene->description().stages[static_cast<std::size_t>(stage)].name; };
      const auto at = [&](int stage) { return surfaces[static_cast<std::size_t>(stage)]; };
      const ShiftResult result = timed(at(from), at(to), directions, options);
      if (to == from + 1) consecutive.push_back(result.field);
      if (from == 0) direct = result.field;
      const auto gated = compareWithTruth(result.field, *scene, from, to),
                 open = compareWithTruth(ungated(result, options.shift.inversion), *scene, from, to);
      reliability += compareWithTruth(evenUnlikely(result, options.shift.inversion), *scene, from, to).reliability;
      const Summary& summary = result.summary;
      std::printf(
          "| %s, %s → %s | %.2f ± %.2f | %.3f / %.3f / %.2f | %.1f %% | %.2f %% | %.3f / %.3f / %.2f | %.1f %% | "
          "%.2f %% | %.2f = %.2f + %.2f + %.2f |\n",
          scene->description().name.c_str(), name(from).c_str(), name(to).c_str(), 1e3 * summary.magnitude.mean,
          1e3 * summary.magnitude.sd, 1e3 * gated.median, 1e3 * gated.p95, 1e3 * gated.largest, 1e2 * gated.coverage,
          1e2 * foreignShare(gated), 1e3 * open.median, 1e3 * open.p95, 1e3 * open.largest, 1e2 * open.coverage,
          1e2 * foreignShare(open), summary.compute_seconds(), summary.projection_seconds, summary.flow_seconds,
          summary.inversion_seconds);
      std::fflush(stdout);
      if (!options.pictures.empty())
        writePictures(result, directions, options.pictures + "/" + name(from) + "__" + name(to));
    }
  const auto pointsOf = [](const cortshift_stereo::Surface& surface) {
    return cv::countNonZero(surface.confidence > 0);
  };
  std::printf("\n%s: surfaces of %d x %d points, %d of the first stage valid; grid %d x %d\n\n",
              scene->description().name.c_str(), surfaces[0].size().width, surfaces[0].size().height,
              pointsOf(surfaces[0]), direct.frame.size.width, direct.frame.size.height);
  if (consecutive.size() > 1 && !options.from_first && options.to.empty()) {
    const Closure closure = closureOf(consecutive, direct);
    std::printf("| closure of the consecutive shifts | median mm | 95 %% mm | points |\n| --- | --- | --- | --- |\n");
    std::printf("| %s | %.4f | %.4f | %zu |\n\n", scene->description().name.c_str(), 1e3 * closure.median,
                1e3 * closure.p95, closure.points);
  }
  return reliability;
}

/// How often vectors of a confidence are right: a row for each tenth of the confidence.
void print(const cortshift_tracking_phantom::Reliability& reliability, const std::string& of) {
  std::printf("\n| vectors of | confidence | right to 0.25 mm | vectors |\n| --- | --- | --- | --- |\n");
  for (std::size_t i = 0; i < reliability.bins.size(); ++i) {
    const auto& bin = reliability.bins[i];
    if (bin.vectors == 0) continue;
    const auto vectors = static_cast<double>(bin.vectors);
    std::printf("| %s, %.1f to %.1f | %.3f | %.3f | %zu |\n", of.c_str(), 0.1 * static_cast<double>(i),
                0.1 * static_cast<double>(i + 1), bin.confidence / vectors, static_cast<double>(bin.right) / vectors,
                bin.vectors);
  }
}

void runAll(const Options& options) {
  std::printf(
      "| shift | length mm | error mm: median / 95 %% / max | coverage | foreign | ungated: error mm | coverage | "
      "foreign | s = projection + flow + inversion |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
  cortshift_tracking_phantom::Reliability reliability;
  std::string names;
  for (const std::string& case_path : options.case_paths) {
    reliability += run(case_path, options);
    names += (names.empty() ? "" : ", ") + caseOf(case_path, options).name;
  }
  print(reliability, names);
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf("\n| peak memory, all surfaces and the phantom included | MB |\n| --- | --- |\n| %s | %.0f |\n",
              names.c_str(), static_cast<double>(usage.ru_maxrss) / 1024);
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
    runAll(options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "shift_benchmark: %s\n", error.what());
    return 1;
  }
  return 0;
}
