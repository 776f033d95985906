#include "cortshift_stereo/admission/pair_synchroniser.hpp"

#include <gtest/gtest.h>

namespace cortshift_stereo {
namespace {

using Synchroniser = PairSynchroniser<int>;
constexpr auto kLeft = Synchroniser::Side::kLeft;
constexpr auto kRight = Synchroniser::Side::kRight;

TEST(PairSynchroniser, pairsImagesOfOneStampInAnyOrder) {
  Synchroniser sync(0, 0.5);
  EXPECT_FALSE(sync.add(kLeft, 100, 1, 0));
  EXPECT_FALSE(sync.add(kLeft, 200, 2, 0));
  const auto first = sync.add(kRight, 100, 11, 0);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->stamp_ns, 100);
  EXPECT_EQ(first->left, 1);
  EXPECT_EQ(first->right, 11);
  const auto second = sync.add(kRight, 200, 12, 0);
  ASSERT_TRUE(second);
  EXPECT_EQ(second->left, 2);
  EXPECT_FALSE(sync.add(kRight, 300, 13, 0));
  const auto third = sync.add(kLeft, 300, 3, 0);
  ASSERT_TRUE(third);
  EXPECT_EQ(third->right, 13);
  EXPECT_TRUE(sync.takeUnpaired(10).empty());
}

TEST(PairSynchroniser, theSameImageFromASecondTopicIsIgnored) {
  Synchroniser sync(0, 0.5);
  sync.add(kLeft, 100, 1, 0);
  EXPECT_FALSE(sync.add(kLeft, 100, 1, 0));
  EXPECT_TRUE(sync.add(kRight, 100, 11, 0));
  EXPECT_FALSE(sync.add(kRight, 100, 11, 0.1));
  EXPECT_FALSE(sync.add(kLeft, 100, 1, 0.1));
  EXPECT_TRUE(sync.takeUnpaired(10).empty());
}

TEST(PairSynchroniser, aReplayedStampPairsAgain) {
  Synchroniser sync(0, 0.5);
  sync.add(kLeft, 100, 1, 0);
  EXPECT_TRUE(sync.add(kRight, 100, 11, 0));
  sync.takeUnpaired(1.0);
  sync.add(kLeft, 100, 1, 1.0);
  EXPECT_TRUE(sync.add(kRight, 100, 11, 1.0));
}

TEST(PairSynchroniser, unsynchronisedImagesAreReportedOnceWithTheirGap) {
  Synchroniser sync(0, 0.5);
  sync.add(kLeft, 100000000, 1, 0);
  sync.add(kRight, 103000000, 11, 0);
  EXPECT_TRUE(sync.takeUnpaired(0.4).empty());
  const auto unpaired = sync.takeUnpaired(0.6);
  ASSERT_EQ(unpaired.size(), 2u);
  EXPECT_EQ(unpaired[0].side, kLeft);
  EXPECT_EQ(unpaired[0].nearest_gap_ns.value(), 3000000);
  EXPECT_NE(unpaired[0].message().find("3.0"), std::string::npos) << unpaired[0].message();
  EXPECT_EQ(unpaired[1].nearest_gap_ns.value(), -3000000);
  EXPECT_TRUE(sync.takeUnpaired(10).empty());
}

TEST(PairSynchroniser, whatIsOlderThanAPairWaitsInVain) {
  Synchroniser sync(0, 100);
  sync.add(kRight, 50, 10, 0);
  sync.add(kLeft, 100, 1, 0);
  sync.add(kRight, 100, 11, 0);
  const auto unpaired = sync.takeUnpaired(0);
  ASSERT_EQ(unpaired.size(), 1u);
  EXPECT_EQ(unpaired[0].stamp_ns, 50);
  EXPECT_EQ(unpaired[0].nearest_gap_ns.value(), 50);
}

TEST(PairSynchroniser, aMissingCameraIsNamed) {
  Synchroniser sync(0, 0.5);
  sync.add(kLeft, 100, 1, 0);
  const auto unpaired = sync.takeUnpaired(1);
  ASSERT_EQ(unpaired.size(), 1u);
  EXPECT_FALSE(unpaired[0].nearest_gap_ns);
  EXPECT_NE(unpaired[0].message().find("no right image came at all"), std::string::npos) << unpaired[0].message();
}

TEST(PairSynchroniser, toleranceTakesTheNearest) {
  Synchroniser sync(5, 0.5);
  sync.add(kRight, 96, 10, 0);
  sync.add(kRight, 102, 11, 0);
  const auto pair = sync.add(kLeft, 100, 1, 0);
  ASSERT_TRUE(pair);
  EXPECT_EQ(pair->right, 11);
  EXPECT_EQ(pair->stamp_ns, 100);
  EXPECT_FALSE(sync.add(kLeft, 110, 2, 0)) << "its nearest is taken";
  const auto mirrored = sync.add(kRight, 113, 12, 0);
  ASSERT_TRUE(mirrored);
  EXPECT_EQ(mirrored->stamp_ns, 110) << "the stamp of the left image";
}

}  // namespace
}  // namespace cortshift_stereo
