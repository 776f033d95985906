// The flow and its OpenCV peers side by side, in one process and on the same images.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/optflow.hpp>
#include <opencv2/video/tracking.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "cortshift_flow/flow.hpp"
#include "cortshift_flow_phantom/flow_errors.hpp"
#include "cortshift_flow_phantom/phantom_cases.hpp"

namespace {

using namespace cortshift_flow_phantom;

constexpr char kUsage[] =
    "usage: benchmark_flow [CASE ...] [NAME=FIRST,SECOND,TRUTH.flo ...]\n"
    "Prints one line of a Markdown table per method and phantom case (default: all cases) or pair of photographs with\n"
    "known flow (pixels without are above 1e9): errors in px, seconds with one and two threads (the smaller of two\n"
    "runs), peak memory. elastix (B-spline mutual information) takes part where it is installed.\n";

constexpr char kElastixParameters[] = R"((FixedInternalImagePixelType "float")
(MovingInternalImagePixelType "float")
(UseDirectionCosines "true")
(Registration "MultiResolutionRegistration")
(Interpolator "BSplineInterpolator")
(ResampleInterpolator "FinalBSplineInterpolator")
(Resampler "DefaultResampler")
(FixedImagePyramid "FixedSmoothingImagePyramid")
(MovingImagePyramid "MovingSmoothingImagePyramid")
(Optimizer "AdaptiveStochasticGradientDescent")
(Transform "BSplineTransform")
(Metric "AdvancedMattesMutualInformation")
(FinalGridSpacingInPhysicalUnits 16)
(NumberOfResolutions 5)
(GridSpacingSchedule 16 8 4 2 1)
(MaximumNumberOfIterations 400)
(NumberOfSpatialSamples 4000)
(NewSamplesEveryIteration "true")
(ImageSampler "RandomCoordinate")
(NumberOfHistogramBins 32)
(BSplineInterpolationOrder 1)
(FinalBSplineInterpolationOrder 3)
(HowToCombineTransforms "Compose")
(AutomaticTransformInitialization "false")
(WriteResultImage "false")
(ResultImageFormat "mhd")
(RandomSeed 1)
)";

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

/// The alternative that the paper's discussion names: B-splines and mutual information.
Method elastix() {
  return {
      "elastix", [](const cv::Mat& first, const cv::Mat& second) {
        char folder[] = "/tmp/benchmark_flow_XXXXXX";
        if (!mkdtemp(folder)) throw std::runtime_error("no temporary folder");
        const std::string at = folder;
        cv::imwrite(at + "/first.png", grey(first));
        cv::imwrite(at + "/second.png", grey(second));
        std::ofstream(at + "/parameters.txt") << kElastixParameters;
        const std::string threads = " -threads " + std::to_string(cv::getNumThreads());
        const std::string quiet = " > /dev/null 2>&1";
        cv::Mat2f flow(first.size(), cv::Vec2f(0, 0));
        if (std::system(("elastix -f " + at + "/first.png -m " + at + "/second.png -p " + at + "/parameters.txt -out " +
                         at + threads + quiet)
                            .c_str()) != 0 ||
            std::system(("transformix -def all -tp " + at + "/TransformParameters.0.txt -out " + at + threads + quiet)
                            .c_str()) != 0)
          throw std::runtime_error("elastix failed; see " + at);
        std::ifstream raw(at + "/deformationField.raw", std::ios::binary);
        raw.read(reinterpret_cast<char*>(flow.data), static_cast<std::streamsize>(flow.total() * flow.elemSize()));
        if (!raw) throw std::runtime_error("elastix left no deformation field in " + at);
        std::filesystem::remove_all(at);
        return cv::Mat(flow);
      }};
}

cv::Mat tunedTvl1(const cv::Mat& first, const cv::Mat& second) {
  const auto tvl1 = cv::optflow::DualTVL1OpticalFlow::create();
  tvl1->setScalesNumber(8);
  tvl1->setScaleStep(0.7);
  tvl1->setLambda(0.3);
  tvl1->setOuterIterations(5);
  tvl1->setInnerIterations(20);
  tvl1->setMedianFiltering(1);
  cv::Mat flow;
  tvl1->calc(grey(first), grey(second), flow);
  return flow;
}

cv::Mat finestDis(const cv::Mat& first, const cv::Mat& second) {
  const auto dis = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM);
  dis->setFinestScale(0);
  dis->setVariationalRefinementIterations(50);
  dis->setVariationalRefinementAlpha(80);
  cv::Mat flow;
  dis->calc(grey(first), grey(second), flow);
  return flow;
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
  std::vector<Method> all = {
      ours("default"),
      ours("fast"),
      ours("ji2014"),
      dis("DIS ultrafast", cv::DISOpticalFlow::PRESET_ULTRAFAST, 0, 20, 5),
      dis("DIS fast", cv::DISOpticalFlow::PRESET_FAST, 0, 20, 5),
      dis("DIS medium", cv::DISOpticalFlow::PRESET_MEDIUM, 0, 20, 5),
      dis("DIS medium + 3 refinements", cv::DISOpticalFlow::PRESET_MEDIUM, 3, 80, 10),
      dis("DIS medium + 5 refinements", cv::DISOpticalFlow::PRESET_MEDIUM, 5, 160, 20),
      dense("DeepFlow", [] { return cv::optflow::createOptFlow_DeepFlow(); }),
      {"DIS finest, 50 refinements", finestDis},
      {"dual TV-L1, tuned", tunedTvl1},
      dense("Farneback", [] { return cv::FarnebackOpticalFlow::create(6, 0.5, false, 15, 5, 7, 1.5); })};
  if (std::system("command -v elastix transformix > /dev/null") == 0)
    all.push_back(elastix());
  else
    std::fputs("benchmark_flow: no elastix row: it is not installed (apt-get install elastix)\n", stderr);
  return all;
}

double secondsWith(int threads, const Method& method, const PlanarPhantom& phantom, cv::Mat& flow) {
  cv::setNumThreads(threads);
  double best = 1e30;
  for (int run = 0; run < 2; ++run) {
    const auto start = std::chrono::steady_clock::now();
    flow = method.run(phantom.first, phantom.second);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    best = std::min(best, seconds);
    if (seconds > 3) break;  // long runs vary little
  }
  return best;
}

/// Prints the row of one method. In a process of its own, so that its peak memory is its own.
void row(const std::string& name, const Method& method, const PlanarPhantom& phantom) {
  std::fflush(stdout);
  const pid_t child = fork();
  if (child == 0) {
    try {
      rusage before{}, after{};
      getrusage(RUSAGE_SELF, &before);
      cv::Mat flow;
      const double one = secondsWith(1, method, phantom, flow), two = secondsWith(2, method, phantom, flow);
      getrusage(RUSAGE_SELF, &after);
      const cv::Mat error = endpointError(flow, phantom.truth);
      const ErrorStatistics core = errorStatistics(error, phantom.core),
                            all = errorStatistics(error, phantom.craniotomy);
      std::printf("| %s | %s | %.4f / %.4f / %.4f | %.1f %% | %.1f %% | %.3f | %.1f | %.3f | %.3f | %ld |\n",
                  name.c_str(), method.name.c_str(), core.median, core.mean, core.percentile_95,
                  100 * core.share_over_005, 100 * core.share_over_05, all.mean, rimBandWidth(error, phantom), one, two,
                  (after.ru_maxrss - before.ru_maxrss) / 1024);
      std::fflush(stdout);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "benchmark_flow: %s: %s\n", method.name.c_str(), error.what());
    }
    _exit(0);
  }
  waitpid(child, nullptr, 0);
}

/// NAME=FIRST,SECOND,TRUTH as a phantom whose whole known area is the core.
PlanarPhantom readPhotographs(const std::string& argument, std::string& name) {
  name = argument.substr(0, argument.find('='));
  std::vector<std::string> files;
  std::stringstream list(argument.substr(name.size() + 1));
  for (std::string file; std::getline(list, file, ',');) files.push_back(file);
  if (files.size() != 3) throw std::invalid_argument("'" + argument + "' is not NAME=FIRST,SECOND,TRUTH.flo");
  PlanarPhantom pair;
  pair.first = cv::imread(files[0]);
  pair.second = cv::imread(files[1]);
  pair.truth = cv::readOpticalFlow(files[2]);
  if (pair.first.empty() || pair.second.size() != pair.first.size() || pair.truth.size() != pair.first.size())
    throw std::invalid_argument("'" + argument + "': files that cannot be read, or differ in size");
  for (cv::Mat* mask : {&pair.core, &pair.patch, &pair.blood}) *mask = cv::Mat::zeros(pair.first.size(), CV_8UC1);
  for (int y = 0; y < pair.core.rows; ++y)
    for (int x = 0; x < pair.core.cols; ++x)
      if (std::abs(pair.truth.at<cv::Vec2f>(y, x)[0]) < 1e9f) pair.core.at<uchar>(y, x) = 255;
  pair.craniotomy = pair.core;
  pair.rim_distance = cv::Mat(pair.first.size(), CV_32FC1, cv::Scalar(1e6));
  return pair;
}

void compare(const std::string& argument) {
  std::string name = argument;
  // One thread until the methods run: a pool of threads does not survive a fork.
  cv::setNumThreads(1);
  const PlanarPhantom phantom = argument.find('=') == std::string::npos ? makePlanarPhantom(phantomCase(argument))
                                                                        : readPhotographs(argument, name);
  for (const Method& method : methods()) row(name, method, phantom);
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
    for (const std::string& name : cases)
      if (name.find('=') == std::string::npos) phantomCase(name);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "benchmark_flow: %s\n%s", error.what(), kUsage);
    return 2;
  }
  try {
    std::printf(
        "| case | method | core median / mean / 95th pct | > 0.05 | > 0.5 | all: mean | rim band | s, 1 thread | s, 2 "
        "threads | MB |\n");
    std::printf("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
    for (const std::string& name : cases) compare(name);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "benchmark_flow: %s\n", error.what());
    return 1;
  }
  return 0;
}
