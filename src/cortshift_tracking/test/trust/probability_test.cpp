#include "cortshift_tracking/trust/probability.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "trust/fitted_weights.hpp"

namespace cortshift_tracking {
namespace {

double odds(double probability) { return probability / (1 - probability); }

/// What a doubt does to the odds of a vector: they rise at none of the steps between the values, and at last are at
/// most this share of the first ones.
template <typename Evidence, typename Probability>
void expectOddsToFall(const char* doubt, Evidence evidence, float Evidence::*value, const std::vector<float>& values,
                      double share, const Probability& probability) {
  std::vector<double> found;
  for (const float one : values) {
    evidence.*value = one;
    found.push_back(odds(probability(evidence)));
  }
  EXPECT_TRUE(std::is_sorted(found.rbegin(), found.rend()))
      << doubt << " raises the odds: " << testing::PrintToString(found);
  EXPECT_LT(found.back(), share * found.front()) << doubt;
}

const MatchEvidence kSound{5e-6F, 0.95F, 0.005F, 0.02F, 5e-6F, 2e-6F};

TEST(ProbabilityOfMatch, FallsWithEveryDoubt) {
  EXPECT_GT(probabilityOfMatch(kSound), 0.99);
  const auto probability = [](const MatchEvidence& evidence) { return probabilityOfMatch(evidence); };
  // From what a good match shows to what a wrong one does.
  expectOddsToFall("flow_error", kSound, &MatchEvidence::flow_error, {5e-6F, 2e-5F, 8e-5F, 3e-4F, 1e-3F}, 0.1,
                   probability);
  expectOddsToFall("correlation", kSound, &MatchEvidence::correlation, {0.95F, 0.7F, 0.4F, 0.0F, -0.5F}, 0.1,
                   probability);
  expectOddsToFall("residual", kSound, &MatchEvidence::residual, {0.005F, 0.01F, 0.03F, 0.08F, 0.2F}, 0.1, probability);
  expectOddsToFall("hue", kSound, &MatchEvidence::hue, {0.02F, 0.05F, 0.15F, 0.4F, 1.0F}, 0.9, probability);
  expectOddsToFall("bend", kSound, &MatchEvidence::bend, {5e-6F, 2e-5F, 6e-5F, 2e-4F, 5e-4F}, 0.25, probability);
  expectOddsToFall("aperture", kSound, &MatchEvidence::aperture, {2e-6F, 1e-5F, 5e-5F, 2e-4F, 1e-3F}, 0.5, probability);
  MatchEvidence none = kSound;
  none.flow_error = std::numeric_limits<float>::infinity();
  EXPECT_EQ(probabilityOfMatch(none), 0);
}

// Whatever is no number is no evidence that a vector is right.
TEST(Probabilities, AreNoneOfWhatIsNoNumber) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (float MatchEvidence::*member :
       {&MatchEvidence::flow_error, &MatchEvidence::correlation, &MatchEvidence::residual, &MatchEvidence::hue,
        &MatchEvidence::bend, &MatchEvidence::aperture}) {
    MatchEvidence evidence = kSound;
    evidence.*member = kNone;
    EXPECT_FALSE(probabilityOfMatch(evidence) >= 0.5F);
  }
  EXPECT_FALSE(probabilityOfHeight({kNone, 2e-5F}) >= 0.5F);
  EXPECT_FALSE(probabilityOfHeight({1e-5F, kNone}) >= 0.5F);
}

TEST(ProbabilityOfHeight, FallsWithEveryDoubt) {
  const HeightEvidence sound{1e-5F, 2e-5F};
  EXPECT_GT(probabilityOfHeight(sound), 0.99);
  const auto probability = [](const HeightEvidence& evidence) { return probabilityOfHeight(evidence); };
  expectOddsToFall("roughness", sound, &HeightEvidence::roughness, {1e-5F, 3e-5F, 1e-4F, 3e-4F, 1e-3F}, 0.1,
                   probability);
  expectOddsToFall("deviation", sound, &HeightEvidence::deviation, {8e-5F, 1.2e-4F, 2.5e-4F, 5e-4F, 1e-3F}, 0.01,
                   probability);
}

double logOdds(float probability) {
  return std::log(static_cast<double>(probability) / (1 - static_cast<double>(probability)));
}

/// Evidence whose cues lie in the middle of these pieces.
MatchEvidence inPieces(const int (&pieces)[kMatchCues]) {
  float cues[kMatchCues];
  for (int i = 0; i < kMatchCues; ++i)
    cues[i] = 0.5F * (kMatchWeights[i].knots[pieces[i]] + kMatchWeights[i].knots[pieces[i] + 1]);
  return {std::exp(cues[0]), 1 - cues[1], std::exp(cues[2]), std::exp(cues[3]), std::exp(cues[4]), std::exp(cues[5])};
}

// What the fit wrote is what is computed: the odds add up over the pieces below, and beyond the knots nothing changes.
TEST(ProbabilityOfMatch, IsWhatWasFitted) {
  float MatchEvidence::*const members[] = {&MatchEvidence::flow_error, &MatchEvidence::correlation,
                                           &MatchEvidence::residual,   &MatchEvidence::hue,
                                           &MatchEvidence::bend,       &MatchEvidence::aperture};
  for (int piece = 0; piece < kSlopes; ++piece) {
    int pieces[kMatchCues];
    std::fill(std::begin(pieces), std::end(pieces), piece);
    const MatchEvidence evidence = inPieces(pieces);
    double logit = kMatchConstant;
    for (const CueWeights& cue : kMatchWeights)
      for (int i = 0; i <= piece; ++i)
        logit += cue.slopes[i] * (cue.knots[i + 1] - cue.knots[i]) * (i == piece ? 0.5 : 1);
    EXPECT_NEAR(logOdds(probabilityOfMatch(evidence)), -logit, 0.01 * (1 + std::abs(logit))) << "piece " << piece;
  }
  for (int i = 0; i < kMatchCues; ++i) {
    int pieces[kMatchCues] = {1, 1, 1, 1, 1, 1};
    const auto at = [&](float cue) {
      MatchEvidence evidence = inPieces(pieces);
      evidence.*members[i] = i == 1 ? 1 - cue : std::exp(cue);
      return probabilityOfMatch(evidence);
    };
    const auto& knots = kMatchWeights[i].knots;
    EXPECT_FLOAT_EQ(at(knots[0] - 1), at(knots[0]));
    EXPECT_FLOAT_EQ(at(knots[kSlopes] + 1), at(knots[kSlopes]));
  }
}

TEST(ProbabilityOfHeight, IsWhatWasFitted) {
  const auto& knots = kRoughnessWeights.knots;
  const float inner = std::exp(knots[1]), rough = std::exp(knots[2]);
  EXPECT_NEAR(logOdds(probabilityOfHeight({inner, 0})) - logOdds(probabilityOfHeight({rough, 0})),
              kRoughnessWeights.slopes[1] * (knots[2] - knots[1]), 1e-2);
  EXPECT_NEAR(logOdds(probabilityOfHeight({std::exp(knots[0] - 1), 0})), -kHeightConstant, 1e-2);
  // 0.25 mm are 2 and 0.5 of the standard deviations that are found.
  const float exact = probabilityOfHeight({inner, 0});
  EXPECT_NEAR(probabilityOfHeight({inner, 0.000125F / kExpectedTooLittle}), 0.9545 * exact, 1e-4);
  EXPECT_NEAR(probabilityOfHeight({inner, 0.0005F / kExpectedTooLittle}), 0.3829 * exact, 1e-4);
}

}  // namespace
}  // namespace cortshift_tracking
