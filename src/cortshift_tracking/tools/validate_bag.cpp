// What is in a recorded case, and what stands in its way, before any run.
#include <ros/console.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>

#include "cortshift_tracking/offline/case_check.hpp"
#include "cortshift_tracking/offline/tool_options.hpp"

namespace {

using namespace cortshift_tracking;
using cortshift_stereo::Options;

constexpr const char* kHelp =
    R"(validate_bag CASE.bag [--config FOLDER] [--settings-calibration FOLDER] [--static-tf FILE]

Say what a recorded case holds, what of the contract it lacks, how far apart the images of its pairs are, where tracking
has gaps, whether its calibration makes sense, when stages can be captured, and what process_bag would warn of or refuse:
the same judgement without the computation. Reads images only where raw and compressed ones must agree.

  --config FOLDER   surface_reconstruction.yaml and shift_tracker.yaml; by default the workspace's config/
  --settings-calibration FOLDER  what calibrate_settings wrote, for other settings than the reference
  --static-tf FILE  YAML file of transforms that the bag's /tf_static lacks, as for publish_static_tf

Exit: 0 stages can be captured; 1 none can, something contradicts itself so that process_bag refuses it, or the bag cannot
be read; 2 bad usage. A tracker that loses the tool for a while is no reason.
)";

void printContents(const CaseRecording& recording) {
  const BagFile& bag = recording.bag();
  std::printf("%s: %.1f MB, %.1f s from %.3f", bag.path().c_str(), 1e-6 * static_cast<double>(bag.size()),
              recording.end().toSec() - recording.begin().toSec(), recording.begin().toSec());
  for (const auto& [compression, chunks] : bag.compressions())
    std::printf(", %llu chunks %s", static_cast<unsigned long long>(chunks),
                compression == "none" ? "not compressed" : compression.c_str());
  std::printf("\n");
  for (const std::string& remark : bag.remarks()) std::printf("  note: %s\n", remark.c_str());
  std::vector<BagTopic> topics = bag.topics();
  std::sort(topics.begin(), topics.end(), [](const BagTopic& a, const BagTopic& b) { return a.name < b.name; });
  std::printf("\ntopics\n");
  for (const BagTopic& topic : topics)
    std::printf("  %-40s %8llu  %s\n", topic.name.c_str(), static_cast<unsigned long long>(topic.messages),
                topic.type.c_str());
}

void printList(const char* title, const std::vector<std::string>& lines) {
  if (lines.empty()) return;
  std::printf("\n%s\n", title);
  for (const std::string& line : lines) std::printf("  %s\n", line.c_str());
}

void printOffsets(const std::vector<double>& offsets) {
  std::printf("\nright stamp minus left stamp [ms]\n");
  const double edges_ms[] = {-HUGE_VAL, -10, -1, -0.1, -1e-6, 1e-6, 0.1, 1, 10, HUGE_VAL};
  for (std::size_t i = 0; i + 1 < std::size(edges_ms); ++i) {
    const auto count = std::count_if(offsets.begin(), offsets.end(), [&](double offset) {
      return 1e3 * offset >= edges_ms[i] && 1e3 * offset < edges_ms[i + 1];
    });
    if (count == 0) continue;
    const int bar =
        static_cast<int>(std::ceil(40.0 * static_cast<double>(count) / static_cast<double>(offsets.size())));
    if (i == 4)
      std::printf("          the same  %8ld  %s\n", count, std::string(static_cast<std::size_t>(bar), '#').c_str());
    else
      std::printf("  %6.1f to %6.1f  %8ld  %s\n", edges_ms[i], edges_ms[i + 1], count,
                  std::string(static_cast<std::size_t>(bar), '#').c_str());
  }
}

void printEdges(const std::vector<EdgeCheck>& edges, double max_gap) {
  std::printf("\nposes on /tf (max_pose_gap %.3f s)\n", max_gap);
  for (const EdgeCheck& edge : edges) {
    const double span = edge.last.toSec() - edge.first.toSec();
    std::printf("  %-28s %8zu samples", edge.name.c_str(), edge.samples);
    if (span > 0) std::printf(", %.1f Hz", static_cast<double>(edge.samples - 1) / span);
    if (edge.gaps > 0)
      std::printf(", %zu gaps, the longest of %.2f s from %.1f s on", edge.gaps, edge.longest, edge.longest_at);
    if (edge.backwards > 0) std::printf(", %zu out of order", edge.backwards);
    std::printf("\n");
  }
}

void printPairs(const CaseCheck& check) {
  struct Count {
    std::size_t pairs = 0;
    double first = 0;
    std::string message;
  };
  std::map<std::string, Count> troubles;
  std::size_t usable = 0;
  for (const PairCheck& pair : check.pairs) {
    if (pair.trouble.empty()) {
      ++usable;
      continue;
    }
    Count& count = troubles[pair.trouble.substr(0, pair.trouble.find(':'))];
    if (count.pairs++ == 0) {
      count.first = pair.seconds;
      count.message = pair.trouble;
    }
  }
  std::printf("\npairs: %zu, nothing known against %zu\n", check.pairs.size(), usable);
  for (const auto& [reason, count] : troubles)
    std::printf("  %zu cannot be used, the first at %.2f s: %s\n", count.pairs, count.first, count.message.c_str());
  std::printf("\nstages can be captured\n");
  if (check.capturable.empty()) std::printf("  nowhere\n");
  for (const Capturable& stretch : check.capturable)
    std::printf("  from %.2f s to %.2f s: %zu pairs\n", stretch.first, stretch.last, stretch.pairs);
}

void run(const Options& options) {
  const OfflineParameters parameters = parametersFrom(options);
  const auto opened = recordingFrom(options, parameters);
  const CaseRecording& recording = *opened;
  printContents(recording);
  std::fflush(stdout);
  const double length = recording.end().toSec() - recording.begin().toSec();
  const CaseCheck check =
      checkCase(recording, parameters.reconstruction, cortshift_stereo::progressBar("looking through", length, "s"));
  printList("missing", check.missing);
  printList("warnings", check.warnings);
  printList("refused", check.contradictions);
  printList("calibration", check.calibration);
  if (!check.image_offsets.empty()) printOffsets(check.image_offsets);
  if (!check.edges.empty()) printEdges(check.edges, parameters.reconstruction.max_pose_gap);
  printPairs(check);
  std::fflush(stdout);
  if (check.capturable.empty()) throw TrackingError("no stage can be captured from " + recording.bag().path().string());
  if (!check.contradictions.empty()) throw TrackingError(check.contradictions.front());
}

}  // namespace

int main(int argc, char** argv) {
  ros::console::set_logger_level(ROSCONSOLE_ROOT_LOGGER_NAME, ros::console::levels::Warn);
  return cortshift_stereo::runTool(argc, argv, kHelp, {"config", "settings-calibration", "static-tf"}, run,
                                   {"CASE.bag"});
}
