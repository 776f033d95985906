// Every stage and field of a case again, from the raw pairs that its stages keep.
#include <ros/console.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "cortshift_stereo/provenance.hpp"
#include "cortshift_stereo/ros/conversions.hpp"
#include "cortshift_tracking/case/case_state.hpp"
#include "cortshift_tracking/offline/case_output.hpp"
#include "cortshift_tracking/offline/recomputation.hpp"
#include "cortshift_tracking/offline/tool_options.hpp"
#include "cortshift_tracking/ros/field_message.hpp"

namespace {

using namespace cortshift_tracking;
using cortshift_stereo::Options;
namespace fs = std::filesystem;

constexpr const char* kHelp =
    R"(recompute CASE_DIR [--output DIR] [--config FOLDER] [--settings-calibration FOLDER] [--gravity X,Y,Z] [--threads N]

Reconstruct every stage of a case again from the raw pair, calibration and poses stored with it, compute its fields again,
with today's code and settings, and print a table of what changed. The case itself is left alone.

  CASE_DIR         stages (or a folder with stages/), and FROM__TO.bag for every field
                   A stage keeps one pair: a surface that was the mean of several changes with it.
                   Gravity, excluded regions and outlines are those of the case (case_state.json)
  --output DIR     new folder for the new stages and fields; by default they are only compared
  --config FOLDER  surface_reconstruction.yaml and shift_tracker.yaml; by default the workspace's config/
  --settings-calibration FOLDER  what calibrate_settings wrote, for other settings than the reference
  --gravity X,Y,Z  direction of gravity in pmr, in place of what the case or the configuration says
  --threads N      0: one for each core; by default what the configuration says

Exit: 0 done, 1 failed, also where only one of the stages or fields did, 2 bad usage.
)";

/// Where the new stages go if nobody wants to keep them.
class Scratch {
 public:
  Scratch() {
    std::string name = (fs::temp_directory_path() / "recompute-XXXXXX").string();
    if (::mkdtemp(&name[0]) == nullptr) throw TrackingError("no temporary folder can be made; set TMPDIR");
    folder_ = name;
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  const fs::path& folder() const { return folder_; }

 private:
  fs::path folder_;
};

void printChange(const std::string& name, const Change& change) {
  std::printf("%-44s %9zu %9zu %9zu  %10.6f %10.6f\n", name.c_str(), change.before, change.after, change.both,
              1e3 * change.median, 1e3 * change.largest);
  std::fflush(stdout);
}

void run(const Options& options) {
  const auto gravity = gravityFrom(options);
  OfflineParameters parameters = parametersFrom(options);
  parameters.reconstruction.average_pairs = 1;  // a stage keeps one
  const CaseFiles files = findCase(options.required("CASE_DIR"));
  const auto kept = options.find("output");
  const Scratch scratch;
  CaseOutput output(kept ? fs::path(*kept) : scratch.folder() / "case");

  std::vector<std::string> failures;
  const auto attempt = [&](const std::string& name, const auto& step) {
    const Stopwatch watch;
    try {
      step();
      output.addTiming(name, watch.seconds());
    } catch (const std::exception& error) {
      failures.push_back(name + ": " + error.what());
      std::printf("%-44s failed\n", name.c_str());
    }
  };
  const auto progress = cortshift_stereo::progressBar(
      "recomputing", static_cast<double>(files.stages.size() + files.fields.size()), "steps");
  double done = 0;
  const auto advance = [&] {
    if (progress) progress(++done / static_cast<double>(files.stages.size() + files.fields.size()));
  };

  std::printf("%-44s %9s %9s %9s  %10s %10s\n%-44s %9s %9s %9s  %10s %10s\n", "", "points", "points", "points",
              "change mm", "change mm", "", "before", "after", "in both", "median", "largest");
  const std::string configuration = parameters.configuration();
  parameters.tracker.shift.configuration = cortshift_stereo::sha256(configuration);  // average_pairs is another one
  const auto printProvenance = [](const cortshift_msgs::Provenance& before, const cortshift_msgs::Provenance& after) {
    const std::string changed = changedProvenance(before, after);
    std::printf("%-44s %s\n", "", changed.empty() ? "same software, configuration and calibration" : changed.c_str());
  };
  cortshift_stereo::PairReconstruction reconstruct(parameters.reconstruction);
  for (const fs::path& path : files.stages) {
    attempt(path.filename().string(), [&] {
      const StageRecord stored = stageFromBag(path);
      const StageRecord made = remakeStage(stored, configuration, reconstruct);
      output.store().add(made);
      const cv::Mat before = cortshift_stereo::surfaceFromPointCloud2(*stored.surface).points;
      const cv::Mat after = cortshift_stereo::surfaceFromPointCloud2(*made.surface).points;
      if (before.size() != after.size()) throw TrackingError("its surface has another size now; compare it by eye");
      printChange("stage " + stored.info.key, changeOf(before, after));
      printProvenance(stored.info.provenance, made.info.provenance);
      printWarnings(made.info.warnings);
    });
    advance();
  }
  FirstNormal first_normal;
  CaseState::Configured configured{parameters.tracker.gravity_pmr, {}};
  if (!parameters.tracker.exclusions.empty()) configured.regions = readRegions(parameters.tracker.exclusions);
  if (const auto state_file = caseStateFile(files))  // a copy, since a damaged one is set aside
    fs::copy_file(*state_file, output.store().folder() / kCaseStateFile);
  const CaseState state(output.store().folder(), configured);
  if (!state.trouble().empty()) failures.push_back(state.trouble());
  const auto stages = output.store().list();
  const Drawn drawn{state.regions(stages), state.outlines(stages)};
  const auto known_gravity = state.gravity();
  const auto gravity_pmr = gravity         ? gravity
                           : known_gravity ? std::make_optional(known_gravity->direction_pmr)
                                           : std::nullopt;
  for (const fs::path& path : files.fields) {
    attempt(path.filename().string(), [&] {
      const cortshift_msgs::DisplacementField stored = fieldFromBag(path);
      const StageShift made = computeStageShift(output.store(), stored.from_key, stored.to_key, first_normal,
                                                gravity_pmr, parameters.tracker.shift, drawn, true);
      output.add(made);
      const cv::Mat before = fieldFromMessage(stored).displacement_pmr;
      const cv::Mat& after = made.result.field.displacement_pmr;
      const std::string name = "shift " + stored.from_key + " to " + stored.to_key;
      if (before.size() == after.size())
        printChange(name, changeOf(before, after));
      else
        std::printf("%-44s its grid has another size: %d x %d, now %d x %d\n", name.c_str(), before.cols, before.rows,
                    after.cols, after.rows);
      std::printf("%-44s mean magnitude %.4f mm, now %.4f mm\n", "", 1e3 * stored.summary.magnitude_mean,
                  1e3 * made.result.summary.magnitude.mean);
      printProvenance(stored.provenance,
                      toMessage(made.result.field, made.result.summary, made.from, made.to).provenance);
      printWarnings(made.result.summary.warnings);
    });
    advance();
  }
  output.finish();
  if (failures.empty()) return;
  std::string what;
  for (const std::string& failure : failures) what += (what.empty() ? "" : "\n") + failure;
  throw TrackingError(what);
}

}  // namespace

int main(int argc, char** argv) {
  ros::console::set_logger_level(ROSCONSOLE_ROOT_LOGGER_NAME, ros::console::levels::Warn);
  return cortshift_stereo::runTool(
      argc, argv, kHelp, {"output", "config", "settings-calibration", "gravity", "threads"}, run, {"CASE_DIR"});
}
