// What the shift must reach from rendered pairs at full resolution, on heads that nothing was chosen on: the stages of
// the benchmark's cases with other vessels, gyri and tissue.
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>
#include <tuple>

#include "cortshift_stereo_phantom/phantom_renderer.hpp"
#include "cortshift_tracking/field/inversion.hpp"
#include "cortshift_tracking/shift.hpp"
#include "cortshift_tracking_phantom/field_truth.hpp"
#include "cortshift_tracking_phantom/seen_surface.hpp"

namespace cortshift_tracking {
namespace {

using namespace cortshift_stereo_phantom;

/// What holds on every head, at most 1.5 times what BENCHMARK.md has for the benchmark's own.
struct Bar {
  const char* case_name;
  const char* stage;
  double median, p95, largest;  // [mm]
  double coverage;
};

std::ostream& operator<<(std::ostream& out, const Bar& bar) { return out << bar.case_name << ", " << bar.stage; }

/// Named before any of them was looked at.
constexpr std::uint32_t kHeads[] = {1011, 1211, 1411};

/// Of all shifts of a head that were measured so far.
std::map<std::uint32_t, cortshift_tracking_phantom::Reliability>& reliabilityOfHeads() {
  static std::map<std::uint32_t, cortshift_tracking_phantom::Reliability> all;
  return all;
}

class PhantomBars : public testing::TestWithParam<std::tuple<std::uint32_t, Bar>> {
 protected:
  struct Case {
    std::shared_ptr<const PhantomScene> scene;
    std::unique_ptr<PhantomPairs> pairs;
    cortshift_stereo::Surface first_pmr;
  };

  /// The last one asked for is kept.
  static Case& caseNamed(const std::string& name, std::uint32_t head) {
    static std::string kept;
    static Case found;
    if (const std::string wanted = name + std::to_string(head); kept != wanted) {
      PhantomCase description = loadPhantomCase(std::string(BENCHMARK_CASES) + "/" + name + ".yaml");
      description.head.seed = head;
      found.scene = std::make_shared<const PhantomScene>(description);
      found.pairs = std::make_unique<PhantomPairs>(found.scene);
      found.first_pmr = cortshift_tracking_phantom::seenSurface(*found.pairs, 0);
      kept = wanted;
    }
    return found;
  }
};

TEST_P(PhantomBars, AreReached) {
  const auto& [head, bar] = GetParam();
  Case& test_case = caseNamed(bar.case_name, head);
  const int stage = test_case.scene->stageIndex(bar.stage);
  ShiftSettings settings;
  const ShiftResult result =
      computeShift(test_case.first_pmr, cortshift_tracking_phantom::seenSurface(*test_case.pairs, stage),
                   {averageNormal(test_case.first_pmr), std::nullopt}, settings);
  const auto error = cortshift_tracking_phantom::compareWithTruth(result.field, *test_case.scene, 0, stage);
  std::printf("head %u\n%s", head, toText(error).c_str());
  EXPECT_LE(1e3 * error.median, bar.median);
  EXPECT_LE(1e3 * error.p95, bar.p95);
  EXPECT_LE(1e3 * error.largest, bar.largest);
  EXPECT_GE(error.coverage, bar.coverage);
  settings.inversion.min_confidence = 0;
  const DisplacementField open = invert(result.field.frame, result.earlier, result.later, result.flow,
                                        result.field.confidence, settings.inversion);
  reliabilityOfHeads()[head] +=
      cortshift_tracking_phantom::compareWithTruth(open, *test_case.scene, 0, stage).reliability;
}

// Head by head and case by case: each case is rendered once.
INSTANTIATE_TEST_SUITE_P(Heads, PhantomBars,
                         testing::Combine(testing::ValuesIn(kHeads),
                                          testing::Values(Bar{"shift_clean", "static", 0.034, 0.135, 1.4, 0.96},
                                                          Bar{"shift_clean", "shift_0_3_mm", 0.034, 0.135, 1.4, 0.96},
                                                          Bar{"shift_clean", "shift_2_mm", 0.034, 0.13, 1.4, 0.96},
                                                          Bar{"shift_clean", "shift_8_mm", 0.04, 0.145, 1.4, 0.96},
                                                          Bar{"shift_clean", "shift_20_mm", 0.049, 0.215, 2.4, 0.93},
                                                          Bar{"shift_disturbed", "bleeding", 0.037, 0.145, 3.5, 0.97},
                                                          Bar{"shift_disturbed", "resection", 0.037, 0.145, 1.5, 0.96},
                                                          Bar{"shift_disturbed", "retractor", 0.034, 0.12, 1.5, 0.935},
                                                          Bar{"shift_wet", "highlights", 0.064, 0.25, 1.4, 0.85})));

/// After the shifts above, which it judges together.
class ConfidenceOfShifts : public testing::TestWithParam<std::uint32_t> {};

TEST_P(ConfidenceOfShifts, SaysHowOftenVectorsAreRight) {
  const auto& found = reliabilityOfHeads();
  ASSERT_EQ(found.count(GetParam()), 1u) << "needs the shifts of this head: run the whole program";
  for (const auto& bin : found.at(GetParam()).bins) {
    const auto vectors = static_cast<double>(bin.vectors);
    ASSERT_GT(vectors, 200);
    const double said = bin.confidence / vectors, right = static_cast<double>(bin.right) / vectors;
    std::printf("head %u: said %.3f, right %.3f, %.0f vectors\n", GetParam(), said, right, vectors);
    // Measured: 0.005 less at most; 0.055 among those that are not reported.
    EXPECT_GT(right, said - (said < 0.5 ? 0.08 : 0.02));
    if (said > 0.95) {
      EXPECT_GT(right, 0.99);
    }
    EXPECT_LT(right, said + 0.25) << "vectors that could be trusted are not";
  }
}

INSTANTIATE_TEST_SUITE_P(Heads, ConfidenceOfShifts, testing::ValuesIn(kHeads));

}  // namespace
}  // namespace cortshift_tracking
