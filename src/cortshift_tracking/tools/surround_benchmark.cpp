// What does not move against the tracker's errors: fields of rendered pairs whose recorded poses are off.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/command_line.hpp"
#include "cortshift_tracking/field/closure.hpp"
#include "cortshift_tracking_phantom/field_truth.hpp"
#include "tracked_case.hpp"

namespace {

using namespace cortshift_stereo_phantom;
using namespace cortshift_tracking;
using namespace cortshift_tracking_phantom;

constexpr const char* kUsage =
    "usage: surround_benchmark --set DIR [--case NAME ...] [--only WHAT ...] [--resolution M] [--drifts N]\n"
    "Phantom cases whose tracker trembles and drifts, as Markdown tables: the error of the field as tracked and as\n"
    "corrected by what does not move, root mean square of error over uncertainty, and the outline of the brain.\n"
    "  --set DIR       of phantom cases\n"
    "  --case NAME     of that folder; may stand more than once. photograph and other if not given, and for tracker "
    "and\n"
    "                  drifts cameras and wet besides\n"
    "  --only WHAT     tracker, drifts, misled, close, outline; may stand more than once. limits, only where it is "
    "named:\n"
    "                  what right and wrong outlines have, for the limits of an outline that is known\n"
    "  --resolution M  of the projection grid [m], 0.0002 if not given\n"
    "  --drifts N      how many random drifts, 20 if not given\n"
    "Exit status: 0 done, 1 failed, 2 bad usage.\n";

struct Wanted {
  std::string set;
  std::vector<std::string> only, cases{"photograph", "other"};
  bool chosen = false;  ///< by --case
  double resolution = 0.0002;
  int drifts = 20;

  bool named(const std::string& what) const { return std::find(only.begin(), only.end(), what) != only.end(); }
  bool wants(const std::string& what) const { return only.empty() || named(what); }
};

Wanted wantedOf(const cortshift_stereo::Options& given) {
  Wanted wanted;
  wanted.set = given.required("set");
  wanted.only = given.list("only");
  wanted.chosen = !given.list("case").empty();
  if (wanted.chosen) wanted.cases = given.list("case");
  wanted.resolution = given.number("resolution", wanted.resolution);
  wanted.drifts = static_cast<int>(given.number("drifts", wanted.drifts));
  if (wanted.drifts < 1) throw cortshift_stereo::UsageError("--drifts: give at least 1");
  return wanted;
}

/// The shift from the first to the last stage as an exact tracker sees it, and its error.
struct ExactShift {
  explicit ExactShift(const TrackedCase& rendered)
      : result(rendered.shift(0, rendered.stages() - 1, exactTracker(rendered.stages()), SurroundMode::kCorrect)),
        error(rendered.errorOf(result, 0, rendered.stages() - 1, exactTracker(rendered.stages()))) {}
  ShiftResult result;
  FieldError error;
};

/// The first and the last of three stages, changed.
TrackedCase firstAndLast(PhantomCase description, const std::function<void(PhantomCase&)>& change, double resolution) {
  description.stages.erase(description.stages.begin() + 1);
  change(description);
  return TrackedCase(description, resolution);
}

void printTracker(const std::string& name, const TrackedCase& rendered) {
  std::vector<DisplacementField> chain;
  DisplacementField direct;
  const auto errors = ordinaryTracker(rendered.stages(), 7);
  for (int from = 0; from < rendered.stages(); ++from)
    for (int to = from + 1; to < rendered.stages(); ++to) {
      const ShiftResult off = rendered.shift(from, to, errors, SurroundMode::kOff),
                        on = rendered.shift(from, to, errors, SurroundMode::kCorrect);
      const FieldError before = rendered.errorOf(off, from, to, errors), after = rendered.errorOf(on, from, to, errors);
      std::printf("| %s, %d → %d | %.3f / %.3f | %.3f / %.3f | %.2f | %s |\n", name.c_str(), from + 1, to + 1,
                  1e3 * before.median, 1e3 * before.p95, 1e3 * after.median, 1e3 * after.p95, after.over_uncertainty,
                  on.summary.surround.c_str());
      std::fflush(stdout);
      if (to == from + 1) chain.push_back(on.field);
      if (from == 0) direct = on.field;
    }
  const Closure closure = closureOf(chain, direct);
  std::printf("| %s, closure | | %.3f / %.3f | | %zu points |\n", name.c_str(), 1e3 * closure.median, 1e3 * closure.p95,
              closure.points);
  std::fflush(stdout);
}

/// Root mean square of a ratio over trials.
struct MeanSquare {
  double sum = 0;
  int count = 0;
  void add(double value) { sum += value * value, ++count; }
  double root() const { return count == 0 ? 0 : std::sqrt(sum / count); }
};

void printDrifts(const std::string& name, const TrackedCase& rendered, int drifts) {
  const int to = rendered.stages() - 1;
  MeanSquare ratio, tracked, corrected;
  int worse = 0, count_corrected = 0;
  double worst = 0, worst_p95 = 0;
  for (int i = 0; i < drifts; ++i) {
    const auto errors = randomDrift(rendered.stages(), static_cast<std::uint64_t>(i));
    const ShiftResult on = rendered.shift(0, to, errors, SurroundMode::kCorrect);
    // What was not corrected is as tracked, bit for bit: no need to compute it twice.
    const FieldError after = rendered.errorOf(on, 0, to, errors),
                     before = on.summary.correction
                                  ? rendered.errorOf(rendered.shift(0, to, errors, SurroundMode::kOff), 0, to, errors)
                                  : after;
    ratio.add(after.over_uncertainty);
    tracked.add(before.median);
    corrected.add(after.median);
    count_corrected += on.summary.correction ? 1 : 0;
    worse += after.median > before.median || after.p95 > before.p95 ? 1 : 0;
    worst = std::max(worst, after.median);
    worst_p95 = std::max(worst_p95, after.p95);
  }
  std::printf("| %s | %.3f | %.3f | %.3f / %.3f | %d of %d | %d | %.2f |\n", name.c_str(), 1e3 * tracked.root(),
              1e3 * corrected.root(), 1e3 * worst, 1e3 * worst_p95, count_corrected, drifts, worse, ratio.root());
  std::fflush(stdout);
}

struct Variant {
  std::string name;
  std::function<void(PhantomCase&)> change;
};

BloodSettings pool(double x, double y, double radius_x, double radius_y) {
  BloodSettings blood;
  blood.outline.centre = {x, y};
  blood.outline.radii = {radius_x, radius_y};
  return blood;
}

BloodSettings cotton(double x, double y, double r) {
  BloodSettings pad = pool(x, y, r, 0.8 * r);
  pad.border = 0.0003;
  pad.cotton = true;
  return pad;
}

/// A wide retractor over the rim.
void addBlade(StageSettings& stage, double heading, double x, double width = 0.025) {
  stage.retractor.emplace();
  stage.retractor->tip = {x, 0.004, 0.006};
  stage.retractor->heading = heading;
  stage.retractor->width = width;
}

/// Things around the brain that move, or hide.
std::vector<Variant> misleading() {
  return {
      {"drape slides by 3 mm",
       [](PhantomCase& c) {
         c.stages[1].drape = {0.0025, 0.0017};
       }},
      {"cotton laid on the brain", [](PhantomCase& c) { c.stages[1].blood = {cotton(0.005, -0.004, 0.010)}; }},
      {"cotton laid over the rim", [](PhantomCase& c) { c.stages[1].blood = {cotton(0.028, 0.008, 0.012)}; }},
      {"cotton there before, gone after", [](PhantomCase& c) { c.stages[0].blood = {cotton(-0.026, 0.006, 0.010)}; }},
      {"retractor over a fifth of the rim, then", [](PhantomCase& c) { addBlade(c.stages[1], 0.4, 0.014); }},
      {"retractor over a fifth of the rim, moved",
       [](PhantomCase& c) { addBlade(c.stages[0], 0.4, 0.015), addBlade(c.stages[1], 0.42, 0.013); }},
      {"bone on one side only",
       [](PhantomCase& c) {
         for (StageSettings& stage : c.stages) stage.microscope.target += Eigen::Vector2d(0.022, 0.0);
         c.cameras.field_of_view = 0.055;
       }},
      {"bone in a corner only",
       [](PhantomCase& c) {
         for (StageSettings& stage : c.stages) stage.microscope.target += Eigen::Vector2d(-0.016, 0.013);
         c.cameras.field_of_view = 0.050;
       }},
  };
}

void printMisled(const std::string& name, const PhantomCase& description, double resolution) {
  for (const Variant& variant : misleading()) {
    const TrackedCase rendered = firstAndLast(description, variant.change, resolution);
    const int to = rendered.stages() - 1;
    const ExactShift exact(rendered);
    const auto& correction = exact.result.summary.correction;
    const double change =
        correction
            ? (correction->transform_pmr * rendered.scene().pointAt(0, 0, 0) - rendered.scene().pointAt(0, 0, 0)).norm()
            : 0;
    for (std::uint64_t seed : {1, 2, 3}) {
      const auto errors = randomDrift(rendered.stages(), seed);
      const ShiftResult on = rendered.shift(0, to, errors, SurroundMode::kCorrect);
      const FieldError after = rendered.errorOf(on, 0, to, errors);
      std::printf("| %s, %s | %.3f: %.3f | %.3f / %.3f | %.2f | %s |\n", name.c_str(), variant.name.c_str(),
                  1e3 * change, 1e3 * exact.error.median, 1e3 * after.median, 1e3 * after.p95, after.over_uncertainty,
                  on.summary.surround.c_str());
      std::fflush(stdout);
    }
  }
}

/// So near that no bone is in view.
void closeUp(PhantomCase& c) { c.cameras.field_of_view = 0.034; }

/// Things on the first stage that an outline has to stand.
std::vector<Variant> views() {
  return {{"plain", [](PhantomCase&) {}},
          {"blood on the rim", [](PhantomCase& c) { c.stages[0].blood = {pool(0.027, 0.010, 0.008, 0.006)}; }},
          {"a rod and a blade",
           [](PhantomCase& c) {
             c.stages[0].rods = {{}};
             c.stages[0].retractor.emplace();
             c.stages[0].retractor->heading = 2.5;
             c.stages[0].retractor->tip = {-0.012, 0.006, 0.006};
           }},
          {"cotton on the brain", [](PhantomCase& c) { c.stages[0].blood = {cotton(0.005, -0.004, 0.009)}; }},
          {"close", closeUp}};
}

struct Tint {
  const char* name;
  cv::Scalar gains;  ///< of blue, green, red
};

/// Lamps, and cameras balanced for others.
const std::vector<Tint> kTints{{"", {1, 1, 1}},
                               {", warm light", {0.6, 0.85, 1.15}},
                               {", cold light", {1.25, 1.0, 0.75}},
                               {", green light", {0.85, 1.15, 0.8}},
                               {", wrong white balance", {0.8, 1.0, 1.2}}};

void printOutlines(const std::string& name, const PhantomCase& description, double resolution) {
  for (const Variant& variant : views()) {
    const TrackedCase rendered = firstAndLast(description, variant.change, resolution);
    const auto errors = exactTracker(2);
    ShiftResult result = rendered.shift(0, 1, errors, SurroundMode::kOff);
    for (const Tint& tint : kTints) {
      Projection tinted = result.earlier;
      tinted.colour = cv::Mat();  // else the earlier one is written over
      cv::multiply(result.earlier.colour, tint.gains, tinted.colour);
      cv::min(tinted.colour, cv::Scalar::all(1), tinted.colour);  // full scale
      const cortshift_tracking::Outline outline = proposeOutline(tinted);
      result.field.brain = outline.brain;
      const auto error = cortshift_tracking_phantom::compareOutline(result.field, result.earlier.mask,
                                                                    result.earlier.height, rendered.scene(), 0);
      const auto number = [&](double value) { return error.known ? cv::format("%.3f", value) : std::string(); };
      std::printf("| %s, %s%s | %s | %s | %s |\n", name.c_str(), variant.name.c_str(), tint.name,
                  number(error.intersection_over_union).c_str(), number(error.mean_ratio).c_str(),
                  outline.text.c_str());
      std::fflush(stdout);
    }
  }
}

/// More of what stands against an outline, from a little to too much.
std::vector<Variant> doubtfulViews() {
  std::vector<Variant> out = views();
  for (const double field : {0.040, 0.046, 0.052, 0.058})
    out.push_back(
        {cv::format("%.0f mm in view", 1e3 * field), [field](PhantomCase& c) { c.cameras.field_of_view = field; }});
  for (const double radius : {0.010, 0.014, 0.018})
    out.push_back({cv::format("a pool of blood of %.0f mm on the rim", 2e3 * radius),
                   [radius](PhantomCase& c) { c.stages[0].blood = {pool(-0.024, 0.010, radius, radius)}; }});
  for (const double width : {0.015, 0.025, 0.035})
    out.push_back({cv::format("a blade of %.0f mm over the rim", 1e3 * width),
                   [width](PhantomCase& c) { addBlade(c.stages[0], 0.4, 0.014, width); }});
  out.push_back({"cotton over the rim", [](PhantomCase& c) { c.stages[0].blood = {cotton(-0.026, 0.006, 0.010)}; }});
  for (Variant& variant : misleading())
    if (variant.name.find("bone ") == 0) out.push_back(variant);
  return out;
}

/// The shares that an outline is judged by, of right and of wrong ones. Of cotton that was not told they say nothing.
void printLimits(const Wanted& options, const std::function<PhantomCase(const std::string&)>& load) {
  constexpr double kRight = 0.93;  // of intersection over union
  struct Sample {
    double shares[4], overlap;
  };
  const char* const names[] = {"seen", "stepped", "clear", "together"};
  const OutlineLimits limits;
  const double limit_of[] = {limits.seen, limits.stepped, limits.clear, limits.together};
  std::vector<Sample> samples;
  std::printf(
      "\n| outline | seen | stepped | clear | together | intersection over union |\n"
      "| --- | --- | --- | --- | --- | --- |\n");
  for (const std::string& name : options.cases)
    for (const Variant& variant : doubtfulViews()) {
      const TrackedCase rendered = firstAndLast(load(name), variant.change, options.resolution);
      const Reference seen = rendered.reference(0, exactTracker(2));
      const FoundOutline found = findOutline(seen.projection);
      DisplacementField field;
      field.frame = seen.frame;
      field.brain = found.brain;
      field.displacement_pmr = cv::Mat(seen.frame.size, CV_32FC3, cv::Scalar::all(0));
      const auto error = cortshift_tracking_phantom::compareOutline(field, seen.projection.mask, seen.projection.height,
                                                                    rendered.scene(), 0);
      std::printf("| %s, %s | %.2f | %.2f | %.2f | %.2f | %.3f |\n", name.c_str(), variant.name.c_str(), found.seen,
                  found.stepped, found.clear, found.together, error.intersection_over_union);
      std::fflush(stdout);
      if (error.known && variant.name.find("cotton") == std::string::npos)
        samples.push_back({{found.seen, found.stepped, found.clear, found.together}, error.intersection_over_union});
    }
  std::printf(
      "\n| limit | of wrong outlines that the others let pass, at most | of right ones, at least | set |\n"
      "| --- | --- | --- | --- |\n");
  for (int k = 0; k < 4; ++k) {
    std::vector<double> wrong, right;
    for (const Sample& sample : samples) {
      bool others = true;
      for (int other = 0; other < 4; ++other) others &= other == k || sample.shares[other] >= limit_of[other];
      if (others) (sample.overlap >= kRight ? right : wrong).push_back(sample.shares[k]);
    }
    const auto text = [](const std::vector<double>& shares, auto extreme) {
      return shares.empty() ? std::string("none") : cv::format("%.2f", *extreme(shares.begin(), shares.end()));
    };
    using Iterator = std::vector<double>::const_iterator;
    std::printf("| %s | %s | %s | %.2f |\n", names[k], text(wrong, std::max_element<Iterator>).c_str(),
                text(right, std::min_element<Iterator>).c_str(), limit_of[k]);
  }
}

void runAll(const Wanted& options) {
  const auto load = [&](const std::string& name) { return loadPhantomCase(options.set + "/" + name + ".yaml"); };
  if (options.wants("tracker") || options.wants("drifts")) {
    std::string drifts;
    std::printf(
        "| pair, tracker of 0.15 mm and 0.04°, drift 0.4 mm and 0.1° | as tracked mm: median / 95 %% | "
        "corrected mm | error / uncertainty | |\n| --- | --- | --- | --- | --- |\n");
    std::vector<std::pair<std::string, std::shared_ptr<TrackedCase>>> all;
    std::vector<std::string> names = options.cases;
    if (!options.chosen) names.insert(names.end(), {"cameras", "wet"});
    for (const std::string& name : names)
      all.emplace_back(name, std::make_shared<TrackedCase>(load(name), options.resolution));
    if (options.wants("tracker"))
      for (const auto& [name, rendered] : all) printTracker(name, *rendered);
    if (options.wants("drifts")) {
      std::printf(
          "\n| random drifts up to 1.5 mm and 0.4° | as tracked mm | corrected mm | worst mm: median / 95 %% | "
          "corrected "
          "| worse than as tracked | error / uncertainty |\n| --- | --- | --- | --- | --- | --- | --- |\n");
      for (const auto& [name, rendered] : all) {
        printDrifts(name, *rendered, options.drifts);
        const ExactShift exact(*rendered);
        std::printf("| %s, exact tracker | | %.3f | | %d of 1 | | %.2f |\n", name.c_str(), 1e3 * exact.error.median,
                    exact.result.summary.correction ? 1 : 0, exact.error.over_uncertainty);
      }
    }
  }
  if (options.wants("close")) {
    std::printf(
        "\n| no bone in view | as tracked mm | corrected mm | worst mm | corrected | worse | error / uncertainty |\n"
        "| --- | --- | --- | --- | --- | --- | --- |\n");
    for (const std::string& name : options.cases) {
      TrackedCase rendered = firstAndLast(load(name), closeUp, options.resolution);
      printDrifts(name + ", close", rendered, options.drifts);
      rendered.settings.surround.pose_translation_sd = rendered.settings.surround.pose_rotation_sd = 0;
      std::printf("| %s, close, a tracker configured as exact | | | | | | %.2f |\n", name.c_str(),
                  ExactShift(rendered).error.over_uncertainty);
    }
  }
  if (options.wants("misled")) {
    std::printf(
        "\n| what may mislead | changed by, with exact tracking: error mm | drifting: error mm: median / 95 %% | error "
        "/ "
        "uncertainty | |\n| --- | --- | --- | --- | --- |\n");
    for (const std::string& name : options.cases) printMisled(name, load(name), options.resolution);
  }
  if (options.wants("outline")) {
    std::printf("\n| outline | intersection over union | brain's mean over the truth | |\n| --- | --- | --- | --- |\n");
    for (const std::string& name : options.cases) printOutlines(name, load(name), options.resolution);
  }
  if (options.named("limits")) printLimits(options, load);
}

}  // namespace

int main(int argc, char** argv) {
  return cortshift_stereo::runTool(argc, argv, kUsage, {"set", "resolution", "drifts"},
                                   [](const cortshift_stereo::Options& given) { runAll(wantedOf(given)); }, {},
                                   {"case", "only"});
}
