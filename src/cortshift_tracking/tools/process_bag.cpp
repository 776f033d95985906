// A recorded case to stages and displacement fields, straight from the bag.
#include <ros/console.h>

#include <cstdio>
#include <string>
#include <vector>

#include "cortshift_tracking/offline/case_capture.hpp"
#include "cortshift_tracking/offline/case_output.hpp"
#include "cortshift_tracking/offline/case_plan.hpp"
#include "cortshift_tracking/offline/tool_options.hpp"

namespace {

using namespace cortshift_tracking;
using cortshift_stereo::Options;
using cortshift_stereo::UsageError;

constexpr const char* kHelp =
    R"(process_bag CASE.bag --capture KEY@SECONDS ... --shift FROM:TO ... --output DIR

Capture stages from a recorded case and compute the displacement between them: the same as a replay, without a master
and a clock, as fast as the machine allows, and the same bits every time.

  --capture KEY@SECONDS ...  stages; SECONDS count from the bag's start. As in a replay: the surface of the newest pair
                             that is not older than max_surface_age, else that of the next pair.
                             KEY@SECONDSxPAIRS: the mean of the next PAIRS pairs of one view, as capture_mean_stage
  --shift FROM:TO ...        displacement from an earlier to a later stage
  --plan FILE                YAML file with both in place of the two options:
                               captures: [{key: K, at: SECONDS, pairs: PAIRS, note: TEXT}, ...]
                               shifts: [{from: K, to: K}, ...]
                               gravity: [x, y, z]
  --output DIR               new folder: stages/, FROM__TO.bag (DisplacementField on /shift/field), summary.csv [m, rad],
                             timing.csv
  --config FOLDER            surface_reconstruction.yaml and shift_tracker.yaml; by default the workspace's config/
  --settings-calibration FOLDER  what calibrate_settings wrote, for other settings of the microscope than the reference
  --static-tf FILE           YAML file of transforms that the bag's /tf_static lacks, as for publish_static_tf
  --gravity X,Y,Z            direction of gravity in pmr, in place of what the configuration says
  --threads N                0: one for each core; by default what the configuration says

A bag that was not closed or is cut is read as far as it goes. A stage that cannot be captured does not stop the others.
Exit: 0 done, 1 failed, also where only one of the stages or shifts did, 2 bad usage.
)";

CasePlan planOf(const Options& options) {
  CasePlan plan;
  try {
    const auto captures = options.list("capture"), shifts = options.list("shift");
    if (const auto file = options.find("plan")) {
      if (!captures.empty() || !shifts.empty())
        throw UsageError("--plan stands in place of --capture and --shift; give one or the other");
      plan = planFromYaml(*file);
    }
    for (const std::string& text : captures) plan.captures.push_back(captureFromText(text));
    for (const std::string& text : shifts) plan.shifts.push_back(shiftFromText(text));
    if (const auto gravity = gravityFrom(options)) plan.gravity_pmr = gravity;
    plan.check();
  } catch (const PlanError& error) {
    throw UsageError(error.what());
  }
  return plan;
}

/// Runs one step; what it refuses is remembered and the next one gets its chance.
class Steps {
 public:
  Steps(std::size_t count, CaseOutput& output)
      : count_(count), output_(output), progress_(cortshift_stereo::progressBar("processing", count, "steps")) {}

  template <typename Step>
  void run(const std::string& name, const Step& step) {
    const Stopwatch watch;
    try {
      const std::string result = step();
      if (progress_) std::fputs("\r\033[K", stderr);  // the bar makes room
      std::printf("%s\n", result.c_str());
      output_.addTiming(name, watch.seconds());
    } catch (const std::exception& error) {
      failures_.push_back(error.what());
    }
    std::fflush(stdout);
    if (progress_) progress_(static_cast<double>(++done_) / static_cast<double>(count_));
  }

  const std::vector<std::string>& failures() const { return failures_; }

 private:
  std::size_t count_, done_ = 0;
  CaseOutput& output_;
  std::function<void(double)> progress_;
  std::vector<std::string> failures_;
};

void run(const Options& options) {
  const CasePlan plan = planOf(options);
  const std::string folder = options.required("output");
  const Stopwatch watch;

  const OfflineParameters parameters = parametersFrom(options);
  Drawn drawn;
  if (!parameters.tracker.exclusions.empty()) drawn.excluded = readRegions(parameters.tracker.exclusions);
  const auto opened = recordingFrom(options, parameters);
  const CaseRecording& recording = *opened;
  for (const std::string& remark : recording.bag().remarks())
    std::fprintf(stderr, "process_bag: %s: %s\n", recording.bag().path().c_str(), remark.c_str());
  printWarnings(recording.remarks());
  const double length = recording.end().toSec() - recording.begin().toSec();

  CaseOutput output(folder);
  Steps steps(plan.captures.size() + plan.shifts.size(), output);
  const CaseCapture capturer(recording, parameters);
  for (const PlannedCapture& planned : plan.captures)
    steps.run("capture " + planned.key, [&] {
      std::string remarks;
      const StageRecord record = capturer.capture(planned, remarks);
      output.store().add(record);
      for (const std::string& warning : record.info.warnings) remarks += "; WARNING: " + warning;
      return "stage '" + planned.key + "': pair at " +
             std::to_string(record.info.stamp.toSec() - recording.begin().toSec()) + " s, " +
             std::to_string(record.info.valid_points) + " points" + remarks;
    });
  FirstNormal first_normal;
  const auto gravity = plan.gravity_pmr ? plan.gravity_pmr : parameters.tracker.gravity_pmr;
  for (const PlannedShift& planned : plan.shifts)
    steps.run("shift " + planned.from + ":" + planned.to, [&] {
      try {
        const StageShift shift = computeStageShift(output.store(), planned.from, planned.to, first_normal, gravity,
                                                   parameters.tracker.shift, drawn);
        output.add(shift);
        return "shift " + planned.from + " to " + planned.to + ": " + toText(shift.result.summary);
      } catch (const std::exception& error) {
        throw TrackingError("no shift from '" + planned.from + "' to '" + planned.to + "': " + error.what());
      }
    });
  output.addTiming("whole case", watch.seconds());
  output.finish();
  std::printf("%.1f s of recording in %.1f s\n", length, watch.seconds());
  if (steps.failures().empty()) return;
  std::string what;
  for (const std::string& failure : steps.failures()) what += (what.empty() ? "" : "\n") + failure;
  throw TrackingError(what);
}

}  // namespace

int main(int argc, char** argv) {
  ros::console::set_logger_level(ROSCONSOLE_ROOT_LOGGER_NAME, ros::console::levels::Warn);
  return cortshift_stereo::runTool(
      argc, argv, kHelp, {"output", "plan", "config", "settings-calibration", "static-tf", "gravity", "threads"}, run,
      {"CASE.bag"}, {"capture", "shift"});
}
