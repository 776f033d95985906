// What is known of the vectors between the stages of a phantom case, and how wrong they are, for script/fit_trust
// shift.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/shift.hpp"
#include "cortshift_tracking_phantom/field_truth.hpp"
#include "cortshift_tracking_phantom/seen_surface.hpp"

namespace {

using namespace cortshift_stereo_phantom;
using namespace cortshift_tracking;

constexpr const char* kUsage =
    "usage: shift_evidence CASE.yaml OUT [--picture FILE | --painted]\n"
    "For every two stages of the case, on grids of 0.1 and 0.2 mm: int32 number of vectors, then for each of them "
    "float32\n"
    "its cues (trust/probability.hpp: those of the match, that of the roughness), the deviation of its height that "
    "the\n"
    "surfaces expect [m], its confidence, 1 where it leads from or to no tissue, and its errors within the plane and "
    "in\n"
    "height [m].\n"
    "  --picture FILE  another photograph as tissue\n"
    "  --painted       no photograph: the painted cortex\n"
    "Exit status: 0 done, 1 failed, 2 bad usage.\n";

constexpr double kResolutions[] = {0.0001, 0.0002};  // [m]
constexpr double kSpacing = 0.0006;                  // of the vectors that are written [m]

constexpr std::size_t kColumns = kMatchCues + 6;

/// kColumns numbers for each vector.
void append(std::vector<float>& out, const ShiftResult& result, const PhantomScene& scene, int from, int to) {
  const VectorEvidence& evidence = result.evidence;
  cv::Mat allowed;
  evidence.allowed.convertTo(allowed, CV_32F, 1.0 / 255.0);
  const DisplacementField every =  // whatever its confidence
      invert(result.field.frame, result.earlier, result.later, result.flow, allowed, InversionSettings());
  const int step = static_cast<int>(std::lround(kSpacing / evidence.resolution));
  for (int row = 0; row < every.frame.size.height; row += step)
    for (int column = 0; column < every.frame.size.width; column += step) {
      const auto error = cortshift_tracking_phantom::errorAt(every, scene, from, to, row, column);
      const float flow_confidence = evidence.flow_confidence.at<float>(row, column);
      if (!error || !(flow_confidence > 0)) continue;
      const auto cues = cuesOf(evidenceAt(row, column, flow_confidence, evidence.agreement, evidence.resolution));
      const HeightEvidence height{evidence.roughness.at<float>(row, column),
                                  evidence.height_errors.at<float>(row, column)};
      out.insert(out.end(), cues.begin(), cues.end());
      out.insert(out.end(), {cueOf(height), height.deviation, result.field.confidence.at<float>(row, column),
                             error->foreign ? 1.0F : 0.0F, static_cast<float>(error->in_plane),
                             static_cast<float>(error->height)});
    }
}

void run(const PhantomCase& description, const char* path) {
  const auto scene = std::make_shared<const PhantomScene>(description);
  PhantomPairs pairs(scene);
  std::vector<cortshift_stereo::Surface> surfaces;
  for (int stage = 0; stage < scene->stageCount(); ++stage)
    surfaces.push_back(cortshift_tracking_phantom::seenSurface(pairs, stage));
  const Directions directions{averageNormal(surfaces[0]), {}};
  std::ofstream out(path, std::ios::binary);
  for (const double resolution : kResolutions) {
    ShiftSettings settings;
    settings.frame.resolution = resolution;
    settings.with_evidence = true;
    settings.surround.mode = SurroundMode::kOff;
    for (int from = 0; from < scene->stageCount(); ++from)
      for (int to = from + 1; to < scene->stageCount(); ++to) {
        std::vector<float> vectors;
        try {
          append(vectors,
                 computeShift(surfaces[static_cast<std::size_t>(from)], surfaces[static_cast<std::size_t>(to)],
                              directions, settings),
                 *scene, from, to);
        } catch (const TrackingError&) {  // nothing is reported, so nothing wrong is
        }
        const auto count = static_cast<std::int32_t>(vectors.size() / kColumns);
        out.write(reinterpret_cast<const char*>(&count), sizeof count);
        out.write(reinterpret_cast<const char*>(vectors.data()),
                  static_cast<std::streamsize>(vectors.size() * sizeof(float)));
      }
  }
  if (!out.flush()) throw std::runtime_error(std::string("cannot write ") + path);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string option = argc > 3 ? argv[3] : "";
  if (!(argc == 3 || (argc == 4 && option == "--painted") || (argc == 5 && option == "--picture"))) {
    const bool help = argc == 2 && std::strcmp(argv[1], "--help") == 0;
    std::fputs(kUsage, help ? stdout : stderr);
    return help ? 0 : 2;
  }
  try {
    PhantomCase description = loadPhantomCase(argv[1]);
    if (option == "--painted") description.head.picture.reset();
    if (option == "--picture") {
      if (!description.head.picture) description.head.picture.emplace();
      description.head.picture->file = argv[4];
    }
    run(description, argv[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "shift_evidence: %s\n", error.what());
    return 1;
  }
  return 0;
}
