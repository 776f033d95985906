// Good pairs of a microscope are accepted, bad ones are not, on photographs: a part of what script/benchmark pairs
// shows.
#include "pair_trials.hpp"

#include <gtest/gtest.h>

#include "cortshift_stereo/reconstruction.hpp"

namespace cortshift_stereo {
namespace {

using namespace cortshift_stereo_test;

PhantomCase caseOf(const std::string& name) {
  PhantomCase description = cortshift_stereo_phantom::loadPhantomCase(std::string(CORTSHIFT_CONFIG_DIR) +
                                                                      "/phantom/choose/" + name + ".yaml");
  description.cameras.size = {512, 384};
  description.image.supersampling = 2;
  return description;
}

class GoodPairs : public ::testing::TestWithParam<const char*> {};

TEST_P(GoodPairs, areAccepted) {
  const PhantomCase description = caseOf(GetParam());
  const int stage = static_cast<int>(description.stages.size()) - 1;
  goodPairs(PhantomPair(description, stage), [&](const PairTrial& trial) {
    SCOPED_TRACE(trial.kind);
    try {
      const auto result = reconstruct(trial.images.left, trial.images.right, Rectifier(trial.truth.model()));
      EXPECT_TRUE(result.warnings.empty()) << result.warnings.front();
    } catch (const PairError& error) {
      ADD_FAILURE() << error.what();
    }
  });
}
INSTANTIATE_TEST_SUITE_P(Disturbances, GoodPairs,
                         ::testing::Values("photograph", "cameras", "defocus", "wet", "weak", "instrument",
                                           "other_wet"));

class BadPairs : public ::testing::TestWithParam<int> {};

TEST_P(BadPairs, areRefusedOrNamed) {
  const int variety = GetParam();
  const PhantomCase description = caseOf(variety % 2 == 0 ? "photograph" : "wet");
  const int stage = variety % 3;
  badPairs(PhantomPair(description, stage), stage, variety, [&](const PairTrial& trial) {
    SCOPED_TRACE(trial.kind);
    try {
      const auto result = reconstruct(trial.images.left, trial.images.right, Rectifier(trial.truth.model()));
      EXPECT_FALSE(result.warnings.empty());
    } catch (const PairError& error) {
      if (trial.kind == "swapped") {
        EXPECT_EQ(error.reason(), "swapped") << error.what();
      }
      if (trial.kind.find("blurred") != std::string::npos) {
        EXPECT_EQ(error.reason(), "defocused") << error.what();
      }
    }
  });
}
INSTANTIATE_TEST_SUITE_P(Kinds, BadPairs, ::testing::Range(0, 4));

}  // namespace
}  // namespace cortshift_stereo
