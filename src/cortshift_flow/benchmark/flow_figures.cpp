// What BENCHMARK.md says about the flow apart from its peers: how far its confidence tells wrong from right, on several
// cortices, and seconds of an idle machine in one process.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <functional>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <string>
#include <vector>

#include "cortshift_flow/flow.hpp"
#include "cortshift_flow_phantom/flow_errors.hpp"
#include "cortshift_flow_phantom/phantom_cases.hpp"

namespace {

using namespace cortshift_flow_phantom;
using cortshift_flow::computeFlow;
using cortshift_flow::FlowSettings;

constexpr char kUsage[] =
    "usage: flow_figures confidence | seconds\n"
    "Prints a Markdown table: of the flow's confidence over five cortices, or of seconds (the least of five runs).\n";

/// "97.0 to 100.0 %", or one number where both print alike.
std::string span(const std::vector<double>& values, const char* format) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const std::string from = cv::format(format, *low), to = cv::format(format, *high);
  return from == to ? from : from + " to " + to;
}

void confidenceRow(const std::string& name, bool masked) {
  std::vector<double> core, all, caught, kept;
  for (const std::uint32_t seed : {1u, 2u, 3u, 5u, 7u}) {
    PlanarPhantom phantom = makePlanarPhantom(phantomCase(name, seed));
    const cv::Mat mask = masked ? phantom.craniotomy : cv::Mat();
    if (masked)
      for (cv::Mat* image : {&phantom.first, &phantom.second}) image->setTo(0, mask == 0);
    const cortshift_flow::FlowResult result = computeFlow(phantom.first, phantom.second, mask, mask, FlowSettings());
    const cv::Mat error = endpointError(result.flow, phantom.truth);
    const ConfidenceStatistics confidence = confidenceStatistics(error, result.confidence, phantom.craniotomy);
    core.push_back(errorStatistics(error, phantom.core).median);
    all.push_back(errorStatistics(error, phantom.craniotomy).mean);
    caught.push_back(100 * confidence.caught);
    kept.push_back(100 * confidence.kept);
  }
  std::printf("| %s%s | %s | %s | %s %% | %s %% |\n", name.c_str(), masked ? ", both images masked" : "",
              span(core, "%.4f").c_str(), span(all, "%.3f").c_str(), span(caught, "%.1f").c_str(),
              span(kept, "%.1f").c_str());
  std::fflush(stdout);
}

void confidence() {
  std::printf(
      "| five cortices | core median px | all: mean px | wrong by 0.5 px: confidence below 0.5 | right to 0.1 px: "
      "confidence above 0.5 |\n| --- | --- | --- | --- | --- |\n");
  for (const char* name : {"outward_all", "inward_all", "outward_overlaid", "inward_overlaid", "outward", "inward"})
    confidenceRow(name, false);
  confidenceRow("outward_all", true);
}

double leastSeconds(int threads, const std::function<void()>& work) {
  cv::setNumThreads(threads);
  double best = 1e30;
  for (int run = 0; run < 5; ++run) {
    const auto start = std::chrono::steady_clock::now();
    work();
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

void seconds() {
  std::printf(
      "| idle machine | default s, 1 / 2 threads | fast s, 1 / 2 threads | DIS medium s, 1 / 2 threads | default / "
      "DIS, "
      "ratio | fast / DIS, ratio |\n| --- | --- | --- | --- | --- | --- |\n");
  for (const char* name : {"outward_all", "inward_all", "outward"}) {
    const PlanarPhantom phantom = makePlanarPhantom(phantomCase(name));
    cv::Mat first, second, flow;
    cv::cvtColor(phantom.first, first, cv::COLOR_BGR2GRAY);
    cv::cvtColor(phantom.second, second, cv::COLOR_BGR2GRAY);
    const auto ours = [&](const std::string& preset, int threads) {
      return leastSeconds(threads,
                          [&] { computeFlow(phantom.first, phantom.second, {}, FlowSettings::preset(preset)); });
    };
    const auto dis = [&](int threads) {
      return leastSeconds(
          threads, [&] { cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM)->calc(first, second, flow); });
    };
    double of[3][2];
    for (const int threads : {1, 2}) {
      of[0][threads - 1] = ours("default", threads);
      of[1][threads - 1] = ours("fast", threads);
      of[2][threads - 1] = dis(threads);
    }
    std::printf("| %s | %.3f / %.3f | %.3f / %.3f | %.3f / %.3f | %.1f | %.1f |\n", name, of[0][0], of[0][1], of[1][0],
                of[1][1], of[2][0], of[2][1], of[0][1] / of[2][1], of[1][1] / of[2][1]);
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc == 2 ? argv[1] : "";
  if (what == "--help" || what == "-h") {
    std::fputs(kUsage, stdout);
    return 0;
  }
  if (what != "confidence" && what != "seconds") {
    std::fputs(kUsage, stderr);
    return 2;
  }
  try {
    what == "confidence" ? confidence() : seconds();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "flow_figures: %s\n", error.what());
    return 1;
  }
  return 0;
}
