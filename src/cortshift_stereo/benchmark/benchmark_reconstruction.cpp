// reconstruct() beside plain semi-global matching on the cortical phantom: accuracy, time, memory, scaling.
#include <malloc.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <functional>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "cortshift_stereo/averaging/frame_average.hpp"
#include "cortshift_stereo/heap.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "phantom_pair.hpp"

namespace {

using namespace cortshift_stereo;
using cortshift_stereo_phantom::StereoImages;
using cortshift_stereo_test::Exposure;
using cortshift_stereo_test::HeightErrors;
using cortshift_stereo_test::PhantomPair;

double processorSeconds() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

struct Seconds {
  double wall, processor;
};

/// The fastest of several runs of each, taken in turns so that a busy machine slows both alike.
std::pair<Seconds, Seconds> compare(const std::function<void()>& first, const std::function<void()>& second) {
  std::pair<Seconds, Seconds> best{{1e9, 1e9}, {1e9, 1e9}};
  for (int run = 0; run < 5; ++run)
    for (const auto& [work, seconds] : {std::pair(&first, &best.first), std::pair(&second, &best.second)}) {
      const int64_t start = cv::getTickCount();
      const double processor = processorSeconds();
      (*work)();
      seconds->wall = std::min(seconds->wall, static_cast<double>(cv::getTickCount() - start) / cv::getTickFrequency());
      seconds->processor = std::min(seconds->processor, processorSeconds() - processor);
    }
  return best;
}

/// OpenCV's matcher as it comes, at the range that was searched.
cv::Mat plainMatch(const RectifiedPair& pair, const SearchRange& range) {
  constexpr int kBlock = 5;
  cv::Mat fixed, disparity;
  cv::StereoSGBM::create(range.start, range.size(), kBlock, 8 * kBlock * kBlock, 32 * kBlock * kBlock, 1, 31, 5, 0, 0,
                         cv::StereoSGBM::MODE_SGBM_3WAY)
      ->compute(pair.left_sharp, pair.right_sharp, fixed);
  fixed.convertTo(disparity, CV_32F, 1.0 / cv::StereoMatcher::DISP_SCALE);
  disparity.setTo(std::numeric_limits<float>::quiet_NaN(),
                  fixed < range.start * static_cast<int>(cv::StereoMatcher::DISP_SCALE));
  return disparity;
}

void row(const char* name, const HeightErrors& errors) {
  std::printf("| %-36s | %7.4f | %7.4f | %6.2f |\n", name, 1e3 * errors.median, 1e3 * errors.p95,
              100 * errors.valid_share);
}

void accuracy(const PhantomPair& phantom) {
  const Rectifier rectifier(phantom.model());
  std::printf("\n| height error on the craniotomy        | median mm | p95 mm | valid %% |\n|---|---|---|---|\n");
  for (const auto& [name, exposure] :
       {std::pair("clean", Exposure{}), std::pair("noise 1/255", Exposure{1.0 / 255, 1, 0}),
        std::pair("noise 4/255", Exposure{4.0 / 255, 1, 0}),
        std::pair("noise 2/255, right gain 0.85", Exposure{2.0 / 255, 0.85, 0})}) {
    const auto images = phantom.take(exposure);
    const ReconstructionResult result = reconstruct(images.left, images.right, rectifier);
    const RectifiedPair pair = rectifier.rectify(images.left, images.right);
    row((std::string("plain SGBM, ") + name).c_str(),
        phantom.heightErrors(plainMatch(pair, result.quality.search_range)));
    row((std::string("reconstruct, ") + name).c_str(), phantom.heightErrors(result.disparity));
  }
  std::vector<Frame> frames;
  for (std::uint64_t frame = 0; frame < 8; ++frame) {
    const auto images = phantom.take({4.0 / 255, 1, frame});
    const ReconstructionResult result = reconstruct(images.left, images.right, rectifier);
    frames.push_back({result.disparity, result.surface_left.colour, result.surface_left.confidence});
  }
  row("mean of 8 pairs, noise 4/255", phantom.heightErrors(averageFrames(frames, phantom.model()).disparity));
}

/// The greatest errors of one noisy pair, and those on a wet surface.
void tails(const PhantomPair& phantom, const char* name, double noise) {
  const auto images = phantom.take({noise, 1, 0});
  const ReconstructionResult result = reconstruct(images.left, images.right, Rectifier(phantom.model()));
  const cv::Mat error = phantom.heightError(result.disparity);
  std::vector<float> errors;
  for (int y = 0; y < error.rows; ++y)
    for (int x = 0; x < error.cols; ++x)
      if (phantom.craniotomy().at<uint8_t>(y, x) && std::isfinite(error.at<float>(y, x)))
        errors.push_back(std::abs(error.at<float>(y, x)));
  const auto mm = [&](double share) { return 1e3 * cortshift_stereo_test::quantile(errors, share); };
  std::printf("| %s | %.4f | %.4f | %.3f | %.3f | %.3f | %.2f |\n", name, mm(0.5), mm(0.95), mm(0.99), mm(0.999), mm(1),
              100.0 * static_cast<double>(errors.size()) / cv::countNonZero(phantom.craniotomy()));
}

/// Median error of the more confident half of the points over that of the less confident half.
double medianRatio(const PhantomPair& phantom, const Exposure& exposure) {
  const auto images = phantom.take(exposure);
  const ReconstructionResult result = reconstruct(images.left, images.right, Rectifier(phantom.model()));
  const cv::Mat error = phantom.heightError(result.disparity);
  std::vector<std::pair<float, float>> points;  // confidence, |error|
  for (int y = 0; y < error.rows; ++y)
    for (int x = 0; x < error.cols; ++x)
      if (phantom.craniotomy().at<uint8_t>(y, x) && std::isfinite(error.at<float>(y, x)))
        points.emplace_back(result.surface_left.confidence.at<float>(y, x), std::abs(error.at<float>(y, x)));
  std::sort(points.begin(), points.end());
  std::vector<float> lower, upper;
  for (std::size_t i = 0; i < points.size(); ++i) (2 * i < points.size() ? lower : upper).push_back(points[i].second);
  return cortshift_stereo_test::quantile(upper, 0.5) / cortshift_stereo_test::quantile(lower, 0.5);
}

void confidence(const PhantomPair& phantom, const PhantomPair& other) {
  std::printf(
      "\n| confidence: median error of the upper half / of the lower half | the demo's head | another head |\n"
      "|---|---|---|\n");
  for (const auto& [name, exposure] :
       {std::pair("clean", Exposure{}), std::pair("noise 1/255", Exposure{1.0 / 255, 1, 0}),
        std::pair("noise 2/255", Exposure{2.0 / 255, 1, 0}), std::pair("noise 4/255", Exposure{4.0 / 255, 1, 0}),
        std::pair("noise 2/255, right gain 0.85", Exposure{2.0 / 255, 0.85, 0})})
    std::printf("| %s | %.2f | %.2f |\n", name, medianRatio(phantom, exposure), medianRatio(other, exposure));
}

/// The same head seen with other numbers of pixels.
StereoModel scaled(const StereoModel& model, double scale) {
  StereoModel out = model;
  for (CameraModel* camera : {&out.left, &out.right}) {
    camera->size = cv::Size(cvRound(camera->size.width * scale), cvRound(camera->size.height * scale));
    for (int r = 0; r < 2; ++r)
      for (int c = 0; c < 3; ++c) {
        camera->K(r, c) *= scale;
        camera->P(r, c) *= scale;
      }
    camera->P(0, 3) *= scale;
  }
  return out;
}

/// Kilobytes of a line of /proc/self/status; 0 where the system has none.
long statusKilobytes(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.compare(0, key.size() + 1, key + ":") == 0) return std::stol(line.substr(key.size() + 1));
  return 0;
}

/// Memory that `work` needs beyond what the process holds already [MB].
long extraMegabytes(const std::function<void()>& work) {
  malloc_trim(0);                                 // what is free goes back first
  std::ofstream("/proc/self/clear_refs") << "5";  // the peak starts from here
  const long before = statusKilobytes("VmRSS");
  work();
  return (statusKilobytes("VmHWM") - before) / 1024;
}

void timeRow(const StereoImages& images, const StereoModel& model, double relief) {
  const Rectifier rectifier(model);
  cv::Mat left, right;
  cv::resize(images.left, left, model.left.size, 0, 0, cv::INTER_CUBIC);
  cv::resize(images.right, right, model.left.size, 0, 0, cv::INTER_CUBIC);
  const RectifiedPair pair = rectifier.rectify(left, right);
  ReconstructionSettings settings;
  settings.relief = relief;
  settings.limits.min_sharpness = 0.05;  // enlarged images have no detail of two pixels
  SearchRange range;
  const auto run = [&] { range = reconstruct(left, right, rectifier, settings).quality.search_range; };
  const long megabytes = extraMegabytes(run);
  const auto [plain, ours] = compare([&] { plainMatch(pair, range); }, run);
  std::printf("| %dx%d | %.2f | %d | %.3f | %.3f | %.2f | %.3f | %.3f | %.2f | %ld |\n", left.cols, left.rows,
              1e-6 * static_cast<double>(left.total()), range.size(), plain.wall, ours.wall, ours.wall / plain.wall,
              plain.processor, ours.processor, ours.processor / plain.processor, megabytes);
  std::fflush(stdout);
}

void time(const PhantomPair& phantom) {
  std::printf(
      "\n| image | Mpx | disparities | SGBM s | cortshift s | ratio | SGBM cpu s | cortshift cpu s | ratio | MB |\n"
      "|---|---|---|---|---|---|---|---|---|---|\n");
  const auto images = phantom.take({1.0 / 255, 1, 0});
  constexpr double kRelief = 0.004, kHighReliefs[] = {0.015, 0.03, 0.06};  // [m]
  for (const double scale : {0.5625, 1.0, 1.5, 2.0, 2448.0 / 1024})
    timeRow(images, scaled(phantom.model(), scale), kRelief);
  for (const double relief : kHighReliefs) timeRow(images, phantom.model(), relief);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::puts("usage: benchmark_reconstruction CASE.yaml WET.yaml STAGE   a dry case, a wet one and its stage");
    return argc == 2 && std::string(argv[1]) == "--help" ? 0 : 2;
  }
  cortshift_stereo::keepFreedMemory();  // as the node does
  try {
    auto description = cortshift_stereo_phantom::loadPhantomCase(argv[1]);
    const PhantomPair phantom(description, 0);
    std::printf("threads: %d\n", cv::getNumThreads());
    accuracy(phantom);
    std::printf(
        "\n| greatest height errors | median mm | p95 mm | p99 mm | p99.9 mm | max mm | valid %% |\n"
        "|---|---|---|---|---|---|---|\n");
    tails(phantom, "noise 1/255", 1.0 / 255);
    const auto wet = cortshift_stereo_phantom::loadPhantomCase(argv[2]);
    const PhantomPair wet_phantom(wet, cortshift_stereo_phantom::PhantomScene(wet).stageIndex(argv[3]));
    tails(wet_phantom, "wet highlights, noise 2/255", 2.0 / 255);
    description.head.seed += 1000;
    confidence(phantom, PhantomPair(description, 0));
    time(phantom);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "benchmark_reconstruction: %s\n", error.what());
    return 1;
  }
  return 0;
}
