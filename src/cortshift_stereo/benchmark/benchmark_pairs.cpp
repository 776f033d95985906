// Which pairs are refused and which are accepted, and how well those are measured, on a set of photograph phantoms.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <opencv2/imgcodecs.hpp>

#include "cortshift_stereo/command_line.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "pair_trials.hpp"

namespace cortshift_stereo {
namespace {

using namespace cortshift_stereo_test;

const char* const kHelp =
    R"(benchmark_pairs --set DIR [--only CASE] [--size WIDTHxHEIGHT] [--bad no] [--verbose yes] [--write DIR]

Judge the good and the bad pairs of a set of phantom cases (config/phantom/choose, config/phantom/judge) and print, as
Markdown, the height errors of each case and how many pairs of each kind were refused.

  --set DIR       folder of case files
  --only CASE     one of them alone, by name without .yaml
  --size WxH      of the images (default: as in the cases)
  --bad no        good pairs alone
  --verbose yes   a line for each pair
  --write DIR     every pair as PNG, too
Exit: 0 no good pair refused and no bad one passed unnoticed, 1 otherwise, 2 bad usage.
)";

struct Counts {
  int pairs = 0, refused = 0, warned = 0;
};

class Bench {
 public:
  Bench(bool verbose, const std::string& folder) : verbose_(verbose), folder_(folder) {}

  void good(const std::string& name, const PairTrial& trial) {
    const auto result = judge(name, trial, good_[trial.kind]);
    if (!result || trial.kind != "as it is") return;
    const cv::Mat error = trial.truth.heightError(result->disparity);
    Errors& errors = errors_[name];
    errors.area += cv::countNonZero(trial.truth.craniotomy());
    for (int y = 0; y < error.rows; ++y)
      for (int x = 0; x < error.cols; ++x)
        if (trial.truth.craniotomy().at<uint8_t>(y, x) && std::isfinite(error.at<float>(y, x)))
          errors.all.push_back(std::abs(error.at<float>(y, x)));
  }
  void bad(const std::string& name, const PairTrial& trial) { judge(name, trial, bad_[trial.kind]); }

  /// @returns whether all went as it should
  bool print() const {
    std::printf("\n| case | median mm | p95 mm | valid %% |\n|---|---|---|---|\n");
    for (const auto& [name, errors] : errors_)
      std::printf("| %s | %.3f | %.3f | %.1f |\n", name.c_str(), 1e3 * quantile(errors.all, 0.5),
                  1e3 * quantile(errors.all, 0.95), 100.0 * static_cast<double>(errors.all.size()) / errors.area);
    int wrongly_refused = 0, passed = 0;
    std::printf("\n| pairs | number | refused | accepted with a warning | accepted |\n|---|---|---|---|---|\n");
    for (const auto* kinds : {&good_, &bad_})
      for (const auto& [kind, counts] : *kinds) {
        const int accepted = counts.pairs - counts.refused - counts.warned;
        std::printf("| %s%s | %d | %d | %d | %d |\n", kinds == &good_ ? "good: " : "bad: ", kind.c_str(), counts.pairs,
                    counts.refused, counts.warned, accepted);
        (kinds == &good_ ? wrongly_refused : passed) += kinds == &good_ ? counts.refused : accepted;
      }
    std::printf("\nGood pairs refused: %d. Bad pairs accepted without a warning: %d.\n", wrongly_refused, passed);
    return wrongly_refused == 0 && passed == 0;
  }

 private:
  struct Errors {
    std::vector<float> all;
    double area = 0;
  };

  std::optional<ReconstructionResult> judge(const std::string& name, const PairTrial& trial, Counts& counts) {
    if (!folder_.empty()) {
      std::string file = folder_ + "/" + name + "_" + std::to_string(number_++) + "_" + trial.kind;
      std::replace(file.begin(), file.end(), ' ', '_');
      cv::imwrite(file + "_left.png", trial.images.left);
      cv::imwrite(file + "_right.png", trial.images.right);
    }
    ++counts.pairs;
    try {
      auto result = reconstruct(trial.images.left, trial.images.right, Rectifier(trial.truth.model()));
      counts.warned += !result.warnings.empty();
      const RowAgreement& rows = result.quality.epipolar;
      if (verbose_)
        std::printf(
            "%s, %s: points %d offset %.3f spread %.3f misalignment %.3f (%.3f) turn_y %.3f (%.3f) deg scale %.1e "
            "(%.1e) sharpness %.2f %.2f detail %.2f %.2f coverage %.2f %.3f s%s%s\n",
            name.c_str(), trial.kind.c_str(), rows.matched, rows.offset, rows.spread, rows.misalignment.value,
            rows.misalignment.sd, rows.turn_y.value * 57.2958, rows.turn_y.sd * 57.2958, rows.scale.value,
            rows.scale.sd, result.quality.left.sharpness, result.quality.right.sharpness, result.quality.left.detail,
            result.quality.right.detail, result.quality.coverage, result.seconds,
            result.warnings.empty() ? "" : " WARNING: ",
            result.warnings.empty() ? "" : result.warnings.front().c_str());
      std::fflush(stdout);
      return result;
    } catch (const PairError& error) {
      ++counts.refused;
      if (verbose_) std::printf("%s, %s: REFUSED %s\n", name.c_str(), trial.kind.c_str(), error.what());
      std::fflush(stdout);
      return std::nullopt;
    }
  }

  bool verbose_;
  std::string folder_;
  int number_ = 0;
  std::map<std::string, Errors> errors_;
  std::map<std::string, Counts> good_, bad_;
};

void run(const Options& options) {
  const std::string only = options.find("only").value_or(""), size = options.find("size").value_or("");
  const bool with_bad = options.find("bad").value_or("yes") != "no";
  Bench bench(options.find("verbose").value_or("no") == "yes", options.find("write").value_or(""));
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(options.required("set")))
    if (entry.path().extension() == ".yaml" && (only.empty() || entry.path().stem() == only)) files.push_back(entry);
  std::sort(files.begin(), files.end());
  if (files.empty()) throw UsageError("no such case in " + options.required("set"));
  int variety = 0;
  for (const auto& file : files) {
    const std::string name = file.stem();
    PhantomCase description = cortshift_stereo_phantom::loadPhantomCase(file);
    if (!size.empty() &&
        std::sscanf(size.c_str(), "%dx%d", &description.cameras.size.width, &description.cameras.size.height) != 2)
      throw UsageError("--size must be WIDTHxHEIGHT");
    for (int stage = 0; stage < static_cast<int>(description.stages.size()); ++stage) {
      const auto judge = [&](const PairTrial& trial) { bench.good(name, trial); };
      const PhantomPair pair(description.atPair(static_cast<std::uint64_t>(stage) + 1), stage);
      goodPairs(pair, judge);
      // The shallowest depth of field, where the case has a lens or little texture.
      if (description.image.depth_of_field > 0 || name == "weak") {
        PhantomCase shallow = description;
        shallow.image.depth_of_field = 0.4;
        const PhantomPair blurred(shallow, stage);
        const ImageSettings& image = shallow.image;
        bench.good(name, {"depth of field 0.4 px/mm", blurred, exposed(blurred.light(0), blurred.light(1), image, 0)});
      }
      const bool has_bad = name == "photograph" || name == "cameras" || name == "defocus" || name == "wet";
      if (with_bad && has_bad)
        badPairs(pair, stage, variety++, [&](const PairTrial& trial) { bench.bad(name, trial); });
    }
  }
  if (!bench.print()) throw std::runtime_error("a good pair was refused or a bad one accepted");
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  using namespace cortshift_stereo;
  return runTool(argc, argv, kHelp, {"set", "only", "size", "bad", "verbose", "write"}, run);
}
