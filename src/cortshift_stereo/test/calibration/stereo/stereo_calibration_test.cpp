#include "cortshift_stereo/calibration/stereo/stereo_calibration.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/affine.hpp>
#include <random>

#include "cortshift_stereo/calibration/board_images.hpp"
#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_verdict.hpp"
#include "cortshift_stereo/geometry/lens.hpp"
#include "real_chessboards.hpp"
#include "scratch_folder.hpp"

namespace cortshift_stereo {
namespace {

const BoardImages& realBoards() {
  static const BoardImages found = findBoards(realChessboards(), kRealBoard);
  return found;
}

/// A microscope's two cameras, verging on a point 0.3 m away.
StereoParameters someHead() {
  StereoParameters head;
  head.size = {1024, 768};
  head.K_left = {2400, 0, 500, 0, 2390, 390, 0, 0, 1};
  head.K_right = {2420, 0, 530, 0, 2425, 370, 0, 0, 1};
  head.D_left = {-0.25, 0, 0, 0, 0};
  head.D_right = {-0.22, 0, 0, 0, 0};
  const cv::Affine3d T_left_right(cv::Vec3d(0.004, -0.083, 0.002), cv::Vec3d(0.025, 0.0003, 0.001));
  head.R_right_left = T_left_right.inv().rotation();
  head.t_right_left = T_left_right.inv().translation();
  return head;
}

/// Noisy views of a board tilted by up to `tilt` [rad]. `spread` says how far from the middle, `late` how far the board
/// moves on before the right camera looks [m].
std::vector<BoardPair> someViews(const StereoParameters& head, const Board& board, int count, double tilt, double noise,
                                 unsigned seed, double spread = 1, double late = 0) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<BoardPair> views;
  for (int i = 0; i < count; ++i) {
    const cv::Affine3d turned(tilt * cv::Vec3d(unit(random), unit(random), unit(random)));
    const cv::Vec3d middle(spread * 0.01 * unit(random), spread * 0.008 * unit(random), 0.3 + 0.03 * unit(random));
    const cv::Affine3d T_left_board(turned.rotation(),
                                    middle - turned.rotation() * cv::Vec3d(4 * board.square, 2.5 * board.square, 0));
    const cv::Affine3d T_right_board =
        cv::Affine3d(head.R_right_left, head.t_right_left) *
        (late > 0 ? T_left_board.translate(late * cv::Vec3d(unit(random), unit(random), 0)) : T_left_board);
    BoardPair view{std::to_string(i + 1), {}, {}};
    view.left = projectPoints(head.left(), board.points(), T_left_board.rvec(), T_left_board.translation());
    view.right = projectPoints(head.right(), board.points(), T_right_board.rvec(), T_right_board.translation());
    for (auto* corners : {&view.left, &view.right})
      for (auto& corner : *corners) corner += noise * cv::Point2d(normal(random), normal(random));
    views.push_back(view);
  }
  return views;
}

const Board kBoard{{9, 6}, 0.008};

std::string refusal(const std::vector<BoardPair>& views) {
  try {
    calibrateStereo(kBoard, someHead().size, views);
  } catch (const CalibrationError& fault) {
    return fault.what();
  }
  return "not refused";
}

std::vector<std::string> namesOf(const std::vector<RejectedView>& views) {
  std::vector<std::string> names;
  for (const auto& view : views) names.push_back(view.name);
  return names;
}

TEST(StereoCalibration, RealBoardsMeetTheirBoundsOnPairsThatTookNoPart) {
  ASSERT_EQ(realBoards().pairs.size(), kRealViews.size());
  for (const std::size_t first : {0, 1}) {
    std::vector<BoardPair> fit, held_out;
    for (std::size_t i = 0; i < realBoards().pairs.size(); ++i)
      (i % 2 == first ? fit : held_out).push_back(realBoards().pairs[i]);
    const auto calibration = calibrateStereo(kRealBoard, realBoards().size, fit);
    const auto errors = checkPairs(calibration.parameters, kRealBoard, held_out);
    std::printf("fitted to %zu pairs (%s), checked on %zu: reprojection %.3f px, epipolar %.3f px, spacing %.3f mm\n",
                fit.size(), calibration.model.c_str(), held_out.size(), errors.reprojection_rms, errors.epipolar_rms,
                errors.spacing_error * 1e3);
    EXPECT_TRUE(calibration.rejected.empty());
    EXPECT_LE(errors.reprojection_rms, 0.315);
    EXPECT_LE(errors.epipolar_rms, 0.2);
    EXPECT_LE(errors.spacing_error, 0.15e-3);
    ASSERT_GE(calibration.scores.size(), 2U);
    EXPECT_EQ(calibration.scores[0].model, "k1");  // the paper's, always reported beside the chosen one
    EXPECT_LT(errors.reprojection_rms, calibration.scores[0].held_out.reprojection_rms);
  }
}

TEST(StereoCalibration, FindsTheParametersAndTakesNoTermsThatAreNotThere) {
  const StereoParameters truth = someHead();
  const auto result = calibrateStereo(kBoard, truth.size, someViews(truth, kBoard, 14, 0.6, 0.05, 1));
  EXPECT_EQ(result.model, "k1");
  EXPECT_NEAR(result.parameters.K_left(0, 0), truth.K_left(0, 0), 0.002 * truth.K_left(0, 0));
  EXPECT_NEAR(result.parameters.K_right(1, 1), truth.K_right(1, 1), 0.002 * truth.K_right(1, 1));
  EXPECT_NEAR(cv::norm(result.parameters.t_right_left), cv::norm(truth.t_right_left), 0.1e-3);
  EXPECT_NEAR(result.used.reprojection_rms, 0.05 * std::sqrt(2), 0.01);
  EXPECT_LT(result.scores.back().held_out.reprojection_rms, 0.1);
  const StereoModel model = rectify(result.parameters);
  EXPECT_NEAR(model.baseline(), cv::norm(truth.t_right_left), 0.1e-3);
}

TEST(StereoCalibration, TakesTermsThatAreThere) {
  StereoParameters truth = someHead();
  truth.D_left = {-0.25, 2.5, 0.003, -0.002, 0};
  truth.D_right = {-0.22, 2.0, -0.002, 0.003, 0};
  const auto result = calibrateStereo(kBoard, truth.size, someViews(truth, kBoard, 14, 0.6, 0.05, 2));
  EXPECT_EQ(result.model, "k1 k2 p1 p2");
}

TEST(StereoCalibration, NamesViewsThatDoNotBelong) {
  auto pairs = realBoards().pairs;
  std::swap(pairs[2].right, pairs[9].right);  // not of the same moment
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (auto& corner : pairs[6].left) corner += 2.5 * cv::Point2d(normal(random), normal(random));  // blurred
  const auto result = calibrateStereo(kRealBoard, realBoards().size, pairs);
  EXPECT_THAT(namesOf(result.rejected), testing::UnorderedElementsAre(pairs[2].name, pairs[6].name, pairs[9].name));
  for (const auto& view : result.rejected)
    EXPECT_THAT(view.reason, testing::HasSubstr(view.name == pairs[6].name ? "left corners are off" : "same moment"));
  EXPECT_LE(result.used.reprojection_rms, 0.25);
}

TEST(StereoCalibration, NamesAViewWhoseBoardMovedBetweenTheTwoImages) {
  const StereoParameters head = someHead();
  auto views = someViews(head, kBoard, 10, 0.6, 0.05, 4);
  for (auto& corner : views[5].right) corner += cv::Point2d(3, 5);
  const auto result = calibrateStereo(kBoard, head.size, views);
  EXPECT_THAT(namesOf(result.rejected), testing::ElementsAre(views[5].name));
}

TEST(StereoCalibration, RefusesTooFewViewsParallelBoardsAndSwappedCameras) {
  const StereoParameters head = someHead();
  EXPECT_THAT(refusal(someViews(head, kBoard, 4, 0.6, 0.05, 5)), testing::HasSubstr("only 4 usable pairs"));
  EXPECT_THAT(refusal({}), testing::HasSubstr("only 0 usable pairs"));
  EXPECT_EQ(refusal(someViews(head, kBoard, static_cast<int>(kFewestPairs), 0.6, 0.02, 8)), "not refused");
  EXPECT_THAT(refusal(someViews(head, kBoard, 12, 0.02, 0.1, 6)), testing::HasSubstr("too parallel"));
  auto swapped = someViews(head, kBoard, 6, 0.6, 0.05, 7);
  for (auto& view : swapped) std::swap(view.left, view.right);
  EXPECT_THAT(refusal(swapped), testing::HasSubstr("are left and right swapped"));
  EXPECT_THROW(checkPairs(head, kBoard, {}), CalibrationError);
}

/// Wide cameras through a lens, and a large board before them.
struct WideHead {
  StereoParameters head = someHead();
  Board board{{9, 6}, 0.02};

  explicit WideHead(LensModel lens) {
    head.K_left = {700, 0, 500, 0, 702, 390, 0, 0, 1};
    head.K_right = {705, 0, 530, 0, 706, 370, 0, 0, 1};
    head.lens = lens;
    if (lens == LensModel::kEquidistant) {
      head.D_left = {-0.05, 0.02, 0, 0};
      head.D_right = {-0.03, 0.01, 0, 0};
    } else {
      head.D_left = {0.2, -0.1, 0.001, -0.001, 0.02, 0.6, 0.05, 0};
      head.D_right = {0.25, -0.12, -0.001, 0.001, 0.02, 0.65, 0.04, 0};
    }
  }
};

TEST(StereoCalibration, FindsEveryLens) {
  for (const LensModel lens : {LensModel::kRationalPolynomial, LensModel::kEquidistant}) {
    SCOPED_TRACE(nameOf(lens));
    const WideHead wide(lens);
    const auto views = someViews(wide.head, wide.board, 12, 0.6, 0.05, 9, 10);
    const auto result = calibrateStereo(wide.board, wide.head.size, views, {}, lens);
    std::printf("%s: terms %s, reprojection %.3f px, focal length %.1f of %.1f px\n", nameOf(lens).c_str(),
                result.model.c_str(), result.used.reprojection_rms, result.parameters.K_left(0, 0),
                wide.head.K_left(0, 0));
    EXPECT_EQ(result.parameters.lens, lens);
    EXPECT_NEAR(result.used.reprojection_rms, 0.05 * std::sqrt(2), 0.015);
    EXPECT_NEAR(result.parameters.K_left(0, 0), 700, 4);
    EXPECT_NEAR(cv::norm(result.parameters.t_right_left), cv::norm(wide.head.t_right_left), 0.1e-3);
    EXPECT_LT(
        checkPairs(result.parameters, wide.board, someViews(wide.head, wide.board, 6, 0.6, 0.05, 10, 10)).epipolar_rms,
        0.15);
    const StereoModel model = rectify(result.parameters);
    EXPECT_EQ(model.left.lens, lens);
    const cv::Point2d middle(511.5, 383.5);
    const cv::Point2d left = rectifyPoints(model.left, {middle}).front();
    EXPECT_LT(std::abs(left.x - middle.x), 60) << "what the middle shows stays near the middle";
  }
}

/// As the tool says it.
std::string verdictOf(const std::vector<BoardPair>& views, const Board& board = kBoard) {
  try {
    return judgeStereo(calibrateStereo(board, someHead().size, views), std::nullopt).line();
  } catch (const CalibrationError& fault) {
    return std::string("verdict: useless: ") + fault.what();
  }
}

TEST(StereoVerdict, GoodViewsAreGoodAndOneBadViewAmongThemIsLeftOut) {
  auto views = someViews(someHead(), kBoard, 14, 0.6, 0.1, 11, 2.5);
  EXPECT_EQ(verdictOf(views), "verdict: good");
  for (auto& corner : views[5].right) corner += cv::Point2d(3, 5);
  EXPECT_EQ(verdictOf(views), "verdict: good");
}

TEST(StereoVerdict, BoardsThatMovedBetweenTheImagesAreUseless) {
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 14, 0.6, 0.1, 12, 2.5, 0.002)),
              testing::AllOf(testing::StartsWith("verdict: useless: "),
                             testing::HasSubstr("the boards were not taken at the same time")));
}

TEST(StereoVerdict, FewMiddlingAndParallelViewsSayWhatToAdd) {
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 7, 0.6, 0.1, 13, 2.5)),
              testing::AllOf(testing::StartsWith("verdict: doubtful: "), testing::HasSubstr("only 7 views were used")));
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 14, 0.6, 0.1, 14, 0.2)),
              testing::AllOf(testing::StartsWith("verdict: doubtful: "),
                             testing::HasSubstr("take views with the board in every corner")));
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 14, 0.02, 0.1, 15, 2.5)),
              testing::AllOf(testing::StartsWith("verdict: useless: "), testing::HasSubstr("too parallel")));
  EXPECT_THAT(verdictOf(someViews(someHead(), kBoard, 14, 0.6, 4, 16, 2.5)),
              testing::AllOf(testing::StartsWith("verdict: useless: "),
                             testing::HasSubstr("rows of views that took no part disagree")));
}

TEST(StereoVerdict, MirroredSwappedAndWronglyMeasuredBoardsAreNamed) {
  auto views = someViews(someHead(), kBoard, 14, 0.6, 0.1, 17, 2.5);
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

TEST(StereoCalibration, SaysWhereACameraIsThatStandsAboveTheOther) {
  StereoParameters above = someHead();
  above.t_right_left = {-0.010, 0.020, 0.0003};
  try {
    rectify(above);
    FAIL() << "accepted";
  } catch (const CalibrationError& fault) {
    EXPECT_THAT(fault.what(), testing::HasSubstr("x = 0.0100 m, y = -0.0200 m"));
  }
}

TEST(StereoReport, WritesFilesThatReconstructionReads) {
  const ScratchFolder folder;
  StereoReport report;
  report.date = dateNow();
  report.images = "some folder";
  report.board = kRealBoard;
  report.calibration = calibrateStereo(kRealBoard, realBoards().size, realBoards().pairs);
  report.calibration.rejected.push_back({"10", "there is no right image"});
  writeStereoCalibration(folder.file("new/calibration"), report);
  const auto read =
      readStereoModelYaml(folder.file("new/calibration/left.yaml"), folder.file("new/calibration/right.yaml"));
  const StereoModel written = rectify(report.calibration.parameters);
  EXPECT_EQ(read.left.K, written.left.K);
  EXPECT_EQ(read.right.P, written.right.P);
  EXPECT_EQ(read.right.D, written.right.D);
  const std::string text = reportText(report);
  for (const char* part : {"date: 20", "inner_corners: 9x6", "model: k1\n", "held_out_in_turn", "epipolar_rms_px",
                           "name: \"10\", reason: \"there is no right image\"", "name: \"14\", reprojection_rms_px"})
    EXPECT_THAT(text, testing::HasSubstr(part));
  EXPECT_THROW(writeStereoCalibration("/proc/nowhere", report), CalibrationError);
  report.verdict.add(Grade::kDoubtful, "only 3 views: take more");
  EXPECT_THAT(reportText(report),
              testing::HasSubstr("verdict: doubtful\nfindings:\n  - {grade: doubtful, what: \"only 3"));
  EXPECT_THAT(remarksText(report), testing::StartsWith("verdict: doubtful: only 3 views: take more\n"));
  report.verdict.add(Grade::kUseless, "the boards moved");
  writeStereoCalibration(folder.file("useless"), report);
  EXPECT_TRUE(std::filesystem::exists(folder.file("useless/report.yaml")));
  EXPECT_FALSE(std::filesystem::exists(folder.file("useless/left.yaml")));
}

}  // namespace
}  // namespace cortshift_stereo
