// The flow and its OpenCV peers side by side, in one process and on the same images.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <opencv2/optflow.hpp>
#include <opencv2/video/tracking.hpp>
#include <string>
#include <vector>

#include "cortshift_flow/flow.hpp"
#include "cortshift_flow_phantom/flow_errors.hpp"
#include "cortshift_flow_phantom/phantom_cases.hpp"

namespace {

using namespace cortshift_flow_phantom;

constexpr char kUsage[] =
    "usage: benchmark_flow [CASE ...]\n"
    "Prints one line of a Markdown table per method and phantom case (default: all cases): errors in px, seconds with\n"
    "one and two threads (the smaller of two runs).\n";

struct Method {
  std::string name;
  std::function<cv::Mat(const cv::Mat& first, const cv::Mat& second)> run;
};

cv::Mat grey(const cv::Mat& image) {
  cv::Mat result;
  cv::cvtColor(image, result, cv::COLOR_BGR2GRAY);
  return result;
}

Method dis(const std::string& name, int preset, int rounds, float alpha, int sweeps) {
  return {name, [=](const cv::Mat& first, const cv::Mat& second) {
            const cv::Mat a = grey(first), b = grey(second);
            cv::Mat flow;
            cv::DISOpticalFlow::create(preset)->calc(a, b, flow);
            const auto refinement = cv::VariationalRefinement::create();
            refinement->setAlpha(alpha);
            refinement->setFixedPointIterations(5);
            refinement->setSorIterations(sweeps);
            for (int round = 0; round < rounds; ++round) refinement->calc(a, b, flow);
            return flow;
          }};
}

Method ours(const std::string& preset) {
  return {"cortshift " + preset, [=](const cv::Mat& first, const cv::Mat& second) {
            return cortshift_flow::computeFlow(first, second, {}, cortshift_flow::FlowSettings::preset(preset)).flow;
          }};
}

Method dense(const std::string& name, const std::function<cv::Ptr<cv::DenseOpticalFlow>()>& create) {
  return {name, [=](const cv::Mat& first, const cv::Mat& second) {
            cv::Mat flow;
            create()->calc(grey(first), grey(second), flow);
            return flow;
          }};
}

std::vector<Method> methods() {
  return {ours("default"),
          ours("fast"),
          ours("ji2014"),
          dis("DIS ultrafast", cv::DISOpticalFlow::PRESET_ULTRAFAST, 0, 20, 5),
          dis("DIS fast", cv::DISOpticalFlow::PRESET_FAST, 0, 20, 5),
          dis("DIS medium", cv::DISOpticalFlow::PRESET_MEDIUM, 0, 20, 5),
          dis("DIS medium + 3 refinements", cv::DISOpticalFlow::PRESET_MEDIUM, 3, 80, 10),
          dis("DIS medium + 5 refinements", cv::DISOpticalFlow::PRESET_MEDIUM, 5, 160, 20),
          dense("DeepFlow", [] { return cv::optflow::createOptFlow_DeepFlow(); }),
          dense("dual TV-L1", [] { return cv::optflow::createOptFlow_DualTVL1(); }),
          dense("Farneback", [] { return cv::FarnebackOpticalFlow::create(); })};
}

double secondsWith(int threads, const Method& method, const PlanarPhantom& phantom, cv::Mat& flow) {
  cv::setNumThreads(threads);
  double best = 1e30;
  for (int run = 0; run < 2; ++run) {
    const auto start = std::chrono::steady_clock::now();
    flow = method.run(phantom.first, phantom.second);
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

void compare(const std::string& name) {
  const PlanarPhantom phantom = makePlanarPhantom(phantomCase(name));
  for (const Method& method : methods()) {
    cv::Mat flow;
    const double one = secondsWith(1, method, phantom, flow), two = secondsWith(2, method, phantom, flow);
    const cv::Mat error = endpointError(flow, phantom.truth);
    const ErrorStatistics core = errorStatistics(error, phantom.core), all = errorStatistics(error, phantom.craniotomy);
    std::printf("| %s | %s | %.4f / %.4f / %.4f | %.1f %% | %.1f %% | %.3f | %.1f | %.3f | %.3f |\n", name.c_str(),
                method.name.c_str(), core.median, core.mean, core.percentile_95, 100 * core.share_over_005,
                100 * core.share_over_05, all.mean, rimBandWidth(error, phantom), one, two);
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> cases(argv + 1, argv + argc);
  if (cases.size() == 1 && (cases[0] == "--help" || cases[0] == "-h")) {
    std::fputs(kUsage, stdout);
    return 0;
  }
  if (cases.empty()) cases = phantomCaseNames();
  try {
    for (const std::string& name : cases) phantomCase(name);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "benchmark_flow: %s\n%s", error.what(), kUsage);
    return 2;
  }
  try {
    std::printf(
        "| case | method | core median / mean / 95th pct | > 0.05 | > 0.5 | all: mean | rim band | s, 1 thread | s, 2 "
        "threads |\n");
    std::printf("| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
    for (const std::string& name : cases) compare(name);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "benchmark_flow: %s\n", error.what());
    return 1;
  }
  return 0;
}
