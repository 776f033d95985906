// Accuracy of the flow on small phantoms, in seconds: that nothing of the method is lost. flow_accuracy_test has the
// full size and what is claimed.
#include <gtest/gtest.h>

#include <cstdio>
#include <string>

#include "cortshift_flow/flow.hpp"
#include "cortshift_flow_phantom/flow_errors.hpp"
#include "cortshift_flow_phantom/phantom_cases.hpp"

namespace cortshift_flow {
namespace {

using namespace cortshift_flow_phantom;

/// A case at a quarter of the pixels, seen as finely.
PlanarPhantom smallPhantom(const std::string& name) {
  PlanarPhantomSettings settings = phantomCase(name, 3);
  settings.size = {512, 384};
  settings.quadrature = 2;
  return makePlanarPhantom(settings);
}

ErrorStatistics coreErrors(const PlanarPhantom& phantom, const FlowSettings& settings = {}) {
  const FlowResult result = computeFlow(phantom.first, phantom.second, {}, settings);
  const ErrorStatistics found = errorStatistics(endpointError(result.flow, phantom.truth), phantom.core);
  std::printf("core %.4f / %.4f px\n", found.median, found.percentile_95);
  return found;
}

struct SmallCase {
  const char* name;
  double median, percentile_95;  // [px]
};

class SmallPhantom : public testing::TestWithParam<SmallCase> {};

TEST_P(SmallPhantom, IsFollowed) {
  const ErrorStatistics found = coreErrors(smallPhantom(GetParam().name));
  EXPECT_LT(found.median, GetParam().median);
  EXPECT_LT(found.percentile_95, GetParam().percentile_95);
}

// 1.5 times what was measured. The surround rests in the last two, and the craniotomy is small.
INSTANTIATE_TEST_SUITE_P(Cases, SmallPhantom,
                         testing::Values(SmallCase{"outward_all", 0.012, 0.03}, SmallCase{"inward_all", 0.012, 0.03},
                                         SmallCase{"noise2", 0.044, 0.4}, SmallCase{"gain", 0.04, 0.88}),
                         [](const auto& info) { return info.param.name; });

TEST(SmallPhantoms, AreFollowedByEveryPreset) {
  const PlanarPhantom phantom = smallPhantom("outward_all");
  EXPECT_LT(coreErrors(phantom, FlowSettings::preset("fast")).median, 0.035);
  EXPECT_LT(coreErrors(phantom, FlowSettings::preset("ji2014")).median, 0.034);
}

}  // namespace
}  // namespace cortshift_flow
