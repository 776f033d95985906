// What computeFlow does with threads: its own, OpenCV's, and others that compute beside it.
#include <gtest/gtest.h>

#include <atomic>
#include <opencv2/core/utility.hpp>
#include <set>
#include <string>
#include <thread>

#include "cortshift_flow/flow.hpp"
#include "small_phantom.hpp"

namespace cortshift_flow {
namespace {

using cortshift_flow_phantom::PlanarPhantom;
using cortshift_flow_test::sameBits;
using cortshift_flow_test::small;

FlowSettings withThreads(const std::string& preset, int threads) {
  FlowSettings settings = FlowSettings::preset(preset);
  settings.threads = threads;
  return settings;
}

/// Sets the number of OpenCV's threads back.
struct OpenCvThreads {
  OpenCvThreads() = default;
  ~OpenCvThreads() { cv::setNumThreads(before); }
  OpenCvThreads(const OpenCvThreads&) = delete;
  OpenCvThreads& operator=(const OpenCvThreads&) = delete;
  const int before = cv::getNumThreads();
};

class EveryPreset : public testing::TestWithParam<std::string> {};

TEST_P(EveryPreset, GivesTheSameBitsForAnyNumberOfThreadsAndEveryRun) {
  const PlanarPhantom& p = small();
  const FlowResult one = computeFlow(p.first, p.second, {}, withThreads(GetParam(), 1));
  for (const int threads : {1, 2, 3}) {
    const FlowResult again = computeFlow(p.first, p.second, {}, withThreads(GetParam(), threads));
    EXPECT_TRUE(sameBits(one.flow, again.flow)) << threads;
    EXPECT_TRUE(sameBits(one.confidence, again.confidence)) << threads;
  }
  const OpenCvThreads guard;
  for (const int threads : {1, 3}) {
    cv::setNumThreads(threads);
    EXPECT_TRUE(sameBits(one.flow, computeFlow(p.first, p.second, {}, withThreads(GetParam(), 2)).flow)) << threads;
  }
}

// The number of OpenCV's threads is the process's: changed while another thread computes, it ends the process.
TEST_P(EveryPreset, LeavesTheNumberOfOpenCvsThreadsAlone) {
  const PlanarPhantom& p = small();
  const OpenCvThreads guard;
  cv::setNumThreads(3);
  std::atomic<bool> over{false};
  std::set<int> seen;
  std::thread watch([&] {
    while (!over) seen.insert(cv::getNumThreads());
  });
  computeFlow(p.first, p.second, {}, withThreads(GetParam(), 2));
  over = true;
  watch.join();
  EXPECT_EQ(seen, std::set<int>{3});
}

INSTANTIATE_TEST_SUITE_P(Presets, EveryPreset, testing::Values("default", "fast", "ji2014"));

}  // namespace
}  // namespace cortshift_flow
