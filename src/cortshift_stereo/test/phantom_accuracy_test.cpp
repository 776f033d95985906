// The accuracy that a surgeon is promised, on the cortical phantom at full resolution.
#include <gtest/gtest.h>

#include <cstdio>
#include <tuple>

#include "cortshift_stereo/averaging/frame_average.hpp"
#include "cortshift_stereo/geometry/lens.hpp"
#include "cortshift_stereo/reconstruction.hpp"
#include "cortshift_stereo/refinement/refinement.hpp"
#include "phantom_pair.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_test::Exposure;
using cortshift_stereo_test::HeightErrors;
using cortshift_stereo_test::PhantomPair;
using cortshift_stereo_test::quantile;

cortshift_stereo_phantom::PhantomCase demoCase() {
  return cortshift_stereo_phantom::loadPhantomCase(std::string(CORTSHIFT_CONFIG_DIR) + "/phantom/phantom_case.yaml");
}

class PhantomAccuracy : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { pair = new PhantomPair(demoCase(), 0); }
  static void TearDownTestSuite() { delete pair; }

  static ReconstructionResult see(const Exposure& exposure) {
    const auto images = pair->take(exposure);
    return reconstruct(images.left, images.right, Rectifier(pair->model()));
  }
  static PhantomPair* pair;
};
PhantomPair* PhantomAccuracy::pair = nullptr;

TEST_F(PhantomAccuracy, cleanImages) {
  const auto images = pair->take({});
  const Rectifier rectifier(pair->model());
  const ReconstructionResult result = reconstruct(images.left, images.right, rectifier);
  const HeightErrors ours = pair->heightErrors(result.disparity);
  EXPECT_LE(ours.median, 0.0145e-3);  // BENCHMARK.md: 0.0099 / 0.0393 mm
  EXPECT_LE(ours.p95, 0.058e-3);
  EXPECT_GE(ours.valid_share, 0.985);
  const RectifiedPair rectified = rectifier.rectify(images.left, images.right);
  const HeightErrors plain =
      pair->heightErrors(matchSemiGlobal(rectified.left_sharp, rectified.right_sharp, result.quality.search_range));
  EXPECT_LT(ours.median, 0.25 * plain.median);
  EXPECT_LT(ours.p95, 0.5 * plain.p95);
}

/// The same head through other lenses: the bounds of the demo case's own.
TEST_F(PhantomAccuracy, everyLensIsAsAccurate) {
  for (const auto& [lens, left, right] :
       {std::tuple(LensModel::kRationalPolynomial, std::vector<double>{0.15, -0.7, 0.002, -0.001, 0.2, 0.5, -0.4, 0.1},
                   std::vector<double>{0.1, 0.5, -0.001, 0.002, 0, 0.4, 0.3, 0}),
        std::tuple(LensModel::kEquidistant, std::vector<double>{-0.2, 0.3, -0.1, 0.05},
                   std::vector<double>{0.1, -0.2, 0, 0})}) {
    SCOPED_TRACE(nameOf(lens));
    cortshift_stereo_phantom::PhantomCase other = demoCase();
    other.cameras.lens = lens;
    other.cameras.left_distortion = left;
    other.cameras.right_distortion = right;
    const PhantomPair seen(other, 0);
    const auto images = seen.take({});
    const HeightErrors errors =
        seen.heightErrors(reconstruct(images.left, images.right, Rectifier(seen.model())).disparity);
    std::printf("%s: height error %.4f / %.4f mm, %.3f valid\n", nameOf(lens).c_str(), 1e3 * errors.median,
                1e3 * errors.p95, errors.valid_share);
    EXPECT_LE(errors.median, 0.025e-3);
    EXPECT_LE(errors.p95, 0.08e-3);
    EXPECT_GE(errors.valid_share, 0.97);
  }
}

TEST_F(PhantomAccuracy, noisyImagesOnePairAndEight) {
  std::vector<Frame> frames;
  for (std::uint64_t frame = 0; frame < 8; ++frame) {
    const ReconstructionResult result = see({4.0 / 255, 1, frame});
    if (frame == 0) {
      const HeightErrors one = pair->heightErrors(result.disparity);
      EXPECT_LE(one.median, 0.047e-3);  // 0.0316 / 0.1322 mm
      EXPECT_LE(one.p95, 0.195e-3);
      EXPECT_GE(one.valid_share, 0.985);
    }
    frames.push_back({result.disparity, result.surface_left.colour, result.surface_left.confidence});
  }
  const HeightErrors eight = pair->heightErrors(averageFrames(frames, pair->model()).disparity);
  EXPECT_LE(eight.median, 0.034e-3);  // 0.0231 / 0.0989 mm
  EXPECT_LE(eight.p95, 0.148e-3);
  EXPECT_GE(eight.valid_share, 0.985);
}

TEST_F(PhantomAccuracy, wetHighlightsCostOnlyWhatTheyHide) {
  cortshift_stereo_phantom::PhantomCase wet_case = demoCase();
  wet_case.light.specular = 0.7;
  wet_case.light.shininess = 1500;
  const PhantomPair wet(wet_case, 2);
  const auto images = wet.take({4.0 / 255, 1, 0});
  const Rectifier rectifier(wet.model());
  const ReconstructionResult result = reconstruct(images.left, images.right, rectifier);
  const HeightErrors errors = wet.heightErrors(result.disparity);
  std::printf("wet: median %.4f, 95 %% %.4f mm, %.3f valid\n", 1e3 * errors.median, 1e3 * errors.p95,
              errors.valid_share);
  // The bounds for one dry pair.
  EXPECT_LE(errors.median, 0.047e-3);
  EXPECT_LE(errors.p95, 0.195e-3);
  EXPECT_GE(errors.valid_share, 0.95);
  const RectifiedPair rectified = rectifier.rectify(images.left, images.right);
  EXPECT_LT(errors.valid_share, 1 - 0.01) << "saturated pixels have no point";
  EXPECT_EQ(cv::countNonZero(~rectified.left_seen & (result.disparity == result.disparity)), 0);
}

/// The confidence on heads that nothing was chosen on.
class ConfidenceOnNewHeads : public ::testing::TestWithParam<std::uint32_t> {
 protected:
  static PhantomPair pairOf(std::uint32_t seed) {
    cortshift_stereo_phantom::PhantomCase head = demoCase();
    head.head.seed = seed;
    return PhantomPair(head, 0);
  }

  /// Confidence and |height error| [m] of every point on the craniotomy, the least confident first.
  static std::vector<std::pair<float, float>> sorted(const PhantomPair& pair, const ReconstructionResult& result) {
    const cv::Mat error = pair.heightError(result.disparity);
    std::vector<std::pair<float, float>> points;
    for (int y = 0; y < error.rows; ++y)
      for (int x = 0; x < error.cols; ++x)
        if (pair.craniotomy().at<uint8_t>(y, x) && std::isfinite(error.at<float>(y, x)))
          points.emplace_back(result.surface_left.confidence.at<float>(y, x), std::abs(error.at<float>(y, x)));
    std::sort(points.begin(), points.end());
    return points;
  }

  /// Median confidence and median error of a part of them, 0 ... 1.
  static std::pair<double, double> part(const std::vector<std::pair<float, float>>& points, double from, double to) {
    const auto at = [&](double share) { return static_cast<std::size_t>(share * static_cast<double>(points.size())); };
    std::vector<float> confidences, errors;
    for (std::size_t i = at(from); i < at(to); ++i) {
      confidences.push_back(points[i].first);
      errors.push_back(points[i].second);
    }
    return {quantile(confidences, 0.5), quantile(errors, 0.5)};
  }
};

TEST_P(ConfidenceOnNewHeads, foretellsTheError) {
  const PhantomPair pair = pairOf(GetParam());
  // Median error of the surer half over that of the other. Noise is what the confidence knows of; without any, what is
  // left is interpolation and the stiffness of the surface.
  for (const auto& [exposure, surer_half] :
       {std::pair(Exposure{0, 1, 0}, 0.75), std::pair(Exposure{1.0 / 255, 1, 0}, 0.7),
        std::pair(Exposure{2.0 / 255, 1, 0}, 0.65), std::pair(Exposure{4.0 / 255, 1, 0}, 0.55),
        std::pair(Exposure{6.0 / 255, 1, 0}, 0.5), std::pair(Exposure{2.0 / 255, 0.85, 0}, 0.6),
        std::pair(Exposure{4.0 / 255, 0.85, 0}, 0.5)}) {
    SCOPED_TRACE(testing::Message() << "noise " << 255 * exposure.noise << "/255, gain " << exposure.right_gain);
    const auto images = pair.take(exposure);
    const auto points = sorted(pair, reconstruct(images.left, images.right, Rectifier(pair.model())));
    const double ratio = part(points, 0.5, 1).second / part(points, 0, 0.5).second;
    std::printf("head %u, noise %.0f/255, gain %.2f: surer half %.3f; seen over promised", GetParam(),
                255 * exposure.noise, exposure.right_gain, ratio);
    EXPECT_LE(ratio, surer_half);
    // Reliability: in each sixth the deviation that the confidence stands for is the one that is seen, within a factor
    // of 2.
    const double metres_per_pixel = 0.3 * 0.3 / (pair.model().left.P(0, 0) * pair.model().baseline());
    for (int sixth = 0; sixth < 6; ++sixth) {
      const auto [confidence, error] = part(points, sixth / 6.0, (sixth + 1) / 6.0);
      const double seen_over_promised = 1.4826 * error / (deviationOf(confidence) * metres_per_pixel);
      std::printf(" %.2f", seen_over_promised);
      EXPECT_GT(seen_over_promised, 0.5) << "sixth " << sixth;
      EXPECT_LT(seen_over_promised, 2.0) << "sixth " << sixth;
    }
    std::printf("\n");
  }
}

INSTANTIATE_TEST_SUITE_P(Heads, ConfidenceOnNewHeads, ::testing::Values(1011u, 1211u, 1411u));

}  // namespace
}  // namespace cortshift_stereo
