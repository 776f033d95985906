#include "cortshift_stereo/calibration/stereo/stereo_verdict.hpp"

#include <gmock/gmock.h>

#include <algorithm>

#include "simulated_stereo_head.hpp"

namespace cortshift_stereo {
namespace {

/// As the tool says it.
std::string verdictOf(const std::vector<BoardPair>& views, const Board& board = kBoard) {
  try {
    return judgeStereo(calibrateStereo(board, someHead().size, views), std::nullopt).line();
  } catch (const CalibrationError& fault) {
    return std::string("verdict: useless: ") + fault.what();
  }
}

TEST(StereoVerdict, GoodViewsAreGoodAndOneBadViewAmongThemIsLeftOut) {
  auto views = someViews(someHead(), kBoard, 11, 0.6, 0.1, 11, 2.5);
  EXPECT_EQ(verdictOf(views), "verdict: good");
  for (auto& corner : views[5].right) corner += cv::Point2d(3, 5);
  EXPECT_EQ(verdictOf(views), "verdict: good");
}

TEST(StereoVerdict, BoardsThatMovedBetweenTheImagesAreUseless) {
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 11, 0.6, 0.1, 12, 2.5, 0.002)),
              testing::AllOf(testing::StartsWith("verdict: useless: "),
                             testing::HasSubstr("the boards were not taken at the same time")));
}

TEST(StereoVerdict, FewMiddlingAndParallelViewsSayWhatToAdd) {
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 7, 0.6, 0.1, 13, 2.5)),
              testing::AllOf(testing::StartsWith("verdict: doubtful: "), testing::HasSubstr("only 7 views were used")));
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 11, 0.6, 0.1, 14, 0.2)),
              testing::AllOf(testing::StartsWith("verdict: doubtful: "),
                             testing::HasSubstr("take views with the board in every corner")));
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 11, 0.02, 0.1, 15, 2.5)),
              testing::AllOf(testing::StartsWith("verdict: useless: "), testing::HasSubstr("too parallel")));
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 11, 0.6, 1.2, 16, 2.5)),
              testing::AllOf(testing::StartsWith("verdict: useless: "),
                             testing::HasSubstr("rows of views that took no part disagree")));
}

TEST(StereoVerdict, MirroredSwappedAndWronglyMeasuredBoardsAreNamed) {
  auto views = someViews(someHead(), kBoard, 11, 0.6, 0.1, 17, 2.5);
  EXPECT_THAT(verdictOf(views, {{9, 6}, 0.08}), testing::AllOf(testing::StartsWith("verdict: doubtful: "),
                                                               testing::HasSubstr("metres, not millimetres")));
  auto swapped = views;
  for (auto& view : swapped) std::swap(view.left, view.right);
  EXPECT_THAT(verdictOf(swapped), testing::HasSubstr("verdict: useless: the right camera is at"));
  for (auto& view : views) {
    for (auto& corner : view.right) corner.x = someHead().size.width - 1 - corner.x;
    for (int row = 0; row < kBoard.corners.height; ++row)  // as the search for boards orders them
      std::reverse(view.right.begin() + row * kBoard.corners.width,
                   view.right.begin() + (row + 1) * kBoard.corners.width);
  }
  EXPECT_THAT(verdictOf(views),
              testing::AllOf(testing::StartsWith("verdict: useless: "), testing::HasSubstr("mirrored")));
}

}  // namespace
}  // namespace cortshift_stereo
