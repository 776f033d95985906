// Accuracy of the flow on phantoms whose truth is known exactly.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

#include "cortshift_flow/flow.hpp"
#include "cortshift_flow_phantom/flow_errors.hpp"
#include "cortshift_flow_phantom/phantom_cases.hpp"

namespace cortshift_flow {
namespace {

using namespace cortshift_flow_phantom;

const PlanarPhantom& phantomOf(const std::string& name) {
  static std::map<std::string, PlanarPhantom> made;
  auto found = made.find(name);
  if (found == made.end()) found = made.emplace(name, makePlanarPhantom(phantomCase(name, 3))).first;
  return found->second;
}

struct Figures {
  ErrorStatistics core, all, patch;
  ConfidenceStatistics confidence;
  double rim = 0;
};

Figures figures(const PlanarPhantom& phantom, const FlowSettings& settings, const cv::Mat& mask = {}) {
  const FlowResult result = computeFlow(phantom.first, phantom.second, mask, settings);
  const cv::Mat error = endpointError(result.flow, phantom.truth);
  return {errorStatistics(error, phantom.core), errorStatistics(error, phantom.craniotomy),
          errorStatistics(error, phantom.patch), confidenceStatistics(error, result.confidence, phantom.craniotomy),
          rimBandWidth(error, phantom)};
}

TEST(Accuracy, TissueThatSlidesUnderTheRim) {
  const Figures f = figures(phantomOf("outward"), {});
  EXPECT_LT(f.core.median, 0.012);
  EXPECT_LT(f.core.percentile_95, 0.1);
  EXPECT_LT(f.all.mean, 0.6);
  EXPECT_LT(f.rim, 10);
  EXPECT_LT(f.patch.largest, 0.6);
  EXPECT_GT(f.confidence.caught, 0.85);
  EXPECT_GT(f.confidence.kept, 0.93);
}

TEST(Accuracy, TissueThatSlidesUnderTheRimOfAMask) {
  const PlanarPhantom& phantom = phantomOf("outward");
  // Most of it is the strip that slides under the rim, which is extrapolated.
  EXPECT_LT(figures(phantom, {}, phantom.craniotomy).all.mean, 0.5);
}

TEST(Accuracy, TissueThatShrinks) {
  const Figures f = figures(phantomOf("inward"), {});
  EXPECT_LT(f.core.median, 0.012);
  EXPECT_LT(f.core.percentile_95, 0.06);
  EXPECT_LT(f.rim, 6);
}

TEST(Accuracy, FastPreset) { EXPECT_LT(figures(phantomOf("outward"), FlowSettings::preset("fast")).core.median, 0.04); }

TEST(Accuracy, SmoothField) { EXPECT_LT(figures(phantomOf("smooth600"), {}).core.median, 0.012); }

TEST(Accuracy, ThePapersModel) {
  EXPECT_LT(figures(phantomOf("smooth600"), FlowSettings::preset("ji2014")).core.median, 0.05);
}

TEST(Accuracy, Noise) {
  EXPECT_LT(figures(phantomOf("noise2"), {}).core.median, 0.04);
  EXPECT_LT(figures(phantomOf("noise5"), {}).core.median, 0.10);
}

TEST(Accuracy, Brightness) {
  EXPECT_LT(figures(phantomOf("gain"), {}).core.median, 0.05);
  EXPECT_LT(figures(phantomOf("vignette"), {}).core.median, 0.06);
}

TEST(Accuracy, BloodHarmsOnlyWhatItHides) {
  const PlanarPhantom& phantom = phantomOf("blood");
  EXPECT_LT(figures(phantom, {}).core.median, 0.014);
}

// The phantom itself: its pixels are means over their areas, computed well enough.
TEST(Phantom, QuadratureErrorIsFarBelowTheFlowsError) {
  PlanarPhantomSettings settings = phantomCase("smooth600", 3);
  settings.size = {96, 96};
  settings.eight_bit = false;
  const cv::Mat usual = makePlanarPhantom(settings).second;
  settings.quadrature = 4;
  const cv::Mat finer = makePlanarPhantom(settings).second;
  // An intensity error e moves the flow by e / |gradient|; compared over the image, both as root mean squares.
  double error = 0, gradient = 0;
  for (int y = 0; y < 95; ++y)
    for (int x = 0; x < 95; ++x) {
      const cv::Vec3f e = usual.at<cv::Vec3f>(y, x) - finer.at<cv::Vec3f>(y, x);
      const cv::Vec3f g = finer.at<cv::Vec3f>(y, x + 1) - finer.at<cv::Vec3f>(y, x);
      error += e.dot(g) * e.dot(g);
      gradient += g.dot(g) * g.dot(g);
    }
  EXPECT_LT(std::sqrt(error / gradient), 0.01);
}

TEST(Phantom, OutwardFlowIsEquationSix) {
  const PlanarPhantom& phantom = phantomOf("outward");
  const double d = 200, expected = 2 * std::sqrt(d);
  const cv::Vec2f flow = phantom.truth.at<cv::Vec2f>(384, 512 + 200);
  EXPECT_NEAR(std::hypot(flow[0], flow[1]), expected, 0.05);
  EXPECT_GT(flow[0], 0);
}

}  // namespace
}  // namespace cortshift_flow

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
