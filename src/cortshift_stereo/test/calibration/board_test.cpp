#include "cortshift_stereo/calibration/board.hpp"

#include <gmock/gmock.h>

#include <fstream>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "cortshift_stereo/calibration/board_images.hpp"
#include "cortshift_stereo_phantom/board_image.hpp"
#include "real_chessboards.hpp"
#include "scratch_folder.hpp"

namespace cortshift_stereo {
namespace {

const Board kBoard{{9, 6}, 0.006};

struct View {
  cv::Size size{640, 480};
  cv::Matx33d K{1500, 0, 320, 0, 1500, 240, 0, 0, 1};
  std::vector<double> D{-0.2, 0.1, 0, 0, 0};
  cv::Affine3d T_camera_board;

  /// Turned by `roll` about the optical axis and tilted, the board's middle in the image's.
  explicit View(double roll, double scale = 1) {
    size = {cvRound(640 * scale), cvRound(480 * scale)};
    for (double* value : {&K(0, 0), &K(0, 2), &K(1, 1), &K(1, 2)}) *value *= scale;
    const cv::Affine3d turned = cv::Affine3d(cv::Vec3d(0.3, -0.2, 0)) * cv::Affine3d(cv::Vec3d(0, 0, roll));
    T_camera_board = {turned.rotation(), cv::Vec3d(0.002, 0.001, 0.3) - turned.rotation() * cv::Vec3d(0.024, 0.015, 0)};
  }
  cv::Mat image() const {
    return cortshift_stereo_phantom::renderBoard({size, K, LensModel::kPlumbBob, D}, T_camera_board, kBoard);
  }
  Corners truth() const {
    Corners corners;
    cv::projectPoints(kBoard.points(), T_camera_board.rvec(), T_camera_board.translation(), K, D, corners);
    return corners;
  }
};

double rmsDistance(const Corners& a, const Corners& b) {
  double squares = 0;
  for (std::size_t i = 0; i < a.size(); ++i) squares += (a[i] - b[i]).dot(a[i] - b[i]);
  return std::sqrt(squares / static_cast<double>(a.size()));
}

template <typename Action>
std::string refusal(const Action& action) {
  try {
    action();
  } catch (const CalibrationError& fault) {
    return fault.what();
  }
  return "not refused";
}

TEST(Board, IsParsedOrRefused) {
  EXPECT_EQ(Board::parse("9x6", 0.025).corners, cv::Size(9, 6));
  EXPECT_THAT(refusal([] { Board::parse("9*6", 0.025); }), testing::HasSubstr("'9*6'"));
  EXPECT_THAT(refusal([] { Board::parse("9x2", 0.025); }), testing::HasSubstr("at least 3x3"));
  EXPECT_THAT(refusal([] { Board::parse("9x6", 25); }), testing::HasSubstr("metres, not millimetres"));
  EXPECT_THAT(refusal([] { Board::parse("9x6", 0); }), testing::HasSubstr("(0, 1] m"));
}

TEST(FindBoard, FindsTheSamePhysicalCornersToATwentiethOfAPixelHoweverTheBoardIsTurned) {
  for (const double roll : {0.0, 0.5, 1.6, 2.5, CV_PI, -1.2}) {
    const View view(roll);
    const auto corners = findBoard(view.image(), kBoard);
    ASSERT_TRUE(corners) << "roll " << roll;
    EXPECT_LT(rmsDistance(*corners, view.truth()), 0.05) << "roll " << roll;
  }
}

TEST(FindBoard, FindsItInLargeImages) {
  const View view(0.3, 3.8);
  const auto corners = findBoard(view.image(), kBoard);
  ASSERT_TRUE(corners);
  EXPECT_LT(rmsDistance(*corners, view.truth()), 0.08);
}

TEST(FindBoard, FindsNothingWhereTheBoardIsNotWhole) {
  EXPECT_FALSE(findBoard(cv::Mat(480, 640, CV_8UC1, cv::Scalar(128)), kBoard));
  cv::Mat cut = View(0).image();
  cut.colRange(0, 250).setTo(128);
  EXPECT_FALSE(findBoard(cut, kBoard));
}

TEST(BoardImages, ListsRealPairsAndSaysWhatIsMissing) {
  const ScratchFolder folder;
  copyRealChessboards(folder.path());
  std::filesystem::remove(folder.file("right03.jpg"));
  cv::imwrite(folder.file("left05.jpg"), cv::Mat(480, 640, CV_8UC1, cv::Scalar(90)));
  const auto found = findBoards(folder.path(), kRealBoard);
  EXPECT_EQ(found.size, cv::Size(640, 480));
  EXPECT_EQ(found.pairs.size(), 11U);
  ASSERT_EQ(found.rejected.size(), 2U);
  EXPECT_EQ(found.rejected[0].name, "03");
  EXPECT_EQ(found.rejected[0].reason, "there is no right image");
  EXPECT_EQ(found.rejected[1].name, "05");
  EXPECT_THAT(found.rejected[1].reason, testing::HasSubstr("not seen in the left image"));
}

TEST(BoardImages, RefusesWhatCannotBeUsedByName) {
  const auto find = [](const std::string& path, const Board& board = kRealBoard) {
    return refusal([&] { findBoards(path, board); });
  };
  EXPECT_THAT(find("/nowhere"), testing::HasSubstr("/nowhere: no such folder"));
  const ScratchFolder empty;
  EXPECT_THAT(find(empty.path()), testing::AllOf(testing::HasSubstr(empty.path()), testing::HasSubstr("no pairs")));

  const ScratchFolder folder;
  copyRealChessboards(folder.path(), 3);
  EXPECT_THAT(find(folder.path(), Board{{8, 5}, 0.025}), testing::HasSubstr("no 8x5 board in any of the 3 pairs"));
  EXPECT_THAT(find(folder.path(), Board{{10, 7}, 0.025}), testing::HasSubstr("not its squares"));

  cv::imwrite(folder.file("right02.png"), cv::Mat(480, 640, CV_8UC1, cv::Scalar(90)));
  EXPECT_THAT(find(folder.path()), testing::HasSubstr("are the same view"));
  std::filesystem::remove(folder.file("right02.png"));
  cv::imwrite(folder.file("right02.jpg"), cv::Mat(240, 320, CV_8UC1, cv::Scalar(90)));
  EXPECT_THAT(find(folder.path()),
              testing::AllOf(testing::HasSubstr("right02.jpg is 320x240"), testing::HasSubstr("640x480")));
  std::ofstream(folder.file("right02.jpg")) << "this is no image";
  EXPECT_THAT(find(folder.path()), testing::HasSubstr("right02.jpg: not readable as an image"));
}

}  // namespace
}  // namespace cortshift_stereo
