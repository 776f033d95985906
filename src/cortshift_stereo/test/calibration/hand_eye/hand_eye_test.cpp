#include "cortshift_stereo/calibration/hand_eye/hand_eye.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cstdio>

#include "cortshift_stereo/calibration/hand_eye/hand_eye_verdict.hpp"
#include "simulated_hand_eye.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kDegree = CV_PI / 180;

struct Errors {
  double translation, rotation;
};

Errors errorsOf(const SimulatedHandEye& truth, const cv::Affine3d& T_microscope_left) {
  const cv::Affine3d difference = truth.T_microscope_left.inv() * T_microscope_left;
  return {cv::norm(difference.translation()), cv::norm(difference.rvec())};
}

std::string refusal(const SimulatedHandEye& truth, const std::vector<HandEyeView>& views) {
  try {
    calibrateHandEye(truth.left, truth.board, views);
  } catch (const CalibrationError& fault) {
    return fault.what();
  }
  return "not refused";
}

TEST(HandEye, IsExactWithoutNoise) {
  std::mt19937 random(1);
  const SimulatedHandEye truth;
  const auto result = calibrateHandEye(truth.left, truth.board, truth.views(12, 0, 0, 0, random));
  const auto errors = errorsOf(truth, result.T_microscope_left);
  EXPECT_LT(errors.translation, 1e-7);
  EXPECT_LT(errors.rotation, 1e-7);
  EXPECT_TRUE(result.rejected.empty());
}

double medianOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

double largestOf(const std::vector<double>& values) { return *std::max_element(values.begin(), values.end()); }

TEST(HandEye, MeetsItsBoundWithTrackerNoiseAndNamesTheGrossOutlier) {
  const SimulatedHandEye truth;
  std::vector<double> translations, rotations, best_methods, sigmas;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    std::mt19937 random(seed);
    auto views = truth.views(40, 0.25e-3, 0.1 * kDegree, 0.1, random);
    auto& outlier = views[seed % views.size()];
    outlier.T_reference_microscope =
        outlier.T_reference_microscope * cv::Affine3d(cv::Vec3d(0.02, -0.03, 0.01), cv::Vec3d(0.008, -0.005, 0.004));
    const auto result = calibrateHandEye(truth.left, truth.board, views);
    ASSERT_EQ(result.rejected.size(), 1U) << "seed " << seed;
    EXPECT_EQ(result.rejected[0].name, outlier.name);
    const auto errors = errorsOf(truth, result.T_microscope_left);
    translations.push_back(errors.translation);
    rotations.push_back(errors.rotation);
    sigmas.push_back(errors.translation / cv::norm(result.position_sd));
    ASSERT_GE(result.methods.size(), 3U);
    double best = 1, spread = 0;
    for (const auto& method : result.methods) {
      best = std::min(best, errorsOf(truth, method.T_microscope_left).translation);
      for (const auto& other : result.methods)
        spread =
            std::max(spread, cv::norm(method.T_microscope_left.translation() - other.T_microscope_left.translation()));
    }
    EXPECT_EQ(result.method_spread, spread);
    EXPECT_GT(spread, 0);
    best_methods.push_back(best);
  }
  std::printf("translation error: median %.3f mm, largest %.3f mm; rotation error: median %.4f deg, largest %.4f deg\n",
              1e3 * medianOf(translations), 1e3 * largestOf(translations), medianOf(rotations) / kDegree,
              largestOf(rotations) / kDegree);
  std::printf("best closed-form method: median %.3f mm, largest %.3f mm; error over its reported deviation: %.2f\n",
              1e3 * medianOf(best_methods), 1e3 * largestOf(best_methods), medianOf(sigmas));
  EXPECT_LE(largestOf(translations), 0.3e-3);
  EXPECT_LE(largestOf(rotations), 0.1 * kDegree);
  EXPECT_LE(medianOf(translations), medianOf(best_methods));
  EXPECT_THAT(medianOf(sigmas), testing::AllOf(testing::Gt(0.3), testing::Lt(1.5)));  // the report tells the truth
}

TEST(HandEye, NamesSeveralOutliersAndABlurredView) {
  const SimulatedHandEye truth;
  std::mt19937 random(5);
  auto views = truth.views(24, 0.25e-3, 0.1 * kDegree, 0.1, random);
  views[3].T_reference_microscope = views[8].T_reference_microscope;
  views[14].T_reference_microscope = views[14].T_reference_microscope.translate(cv::Vec3d(0, 0.006, 0));
  std::normal_distribution<double> normal;
  for (auto& corner : views[20].corners) corner += 3.0 * cv::Point2d(normal(random), normal(random));
  const auto result = calibrateHandEye(truth.left, truth.board, views);
  std::vector<std::string> names;
  for (const auto& view : result.rejected) names.push_back(view.name);
  EXPECT_THAT(names, testing::UnorderedElementsAre("view4", "view15", "view21"));
  EXPECT_LE(errorsOf(truth, result.T_microscope_left).translation, 0.5e-3);
}

TEST(HandEye, RefusesTooLittleRotation) {
  std::mt19937 random(2);
  SimulatedHandEye truth;
  truth.one_axis = true;
  EXPECT_THAT(refusal(truth, truth.views(20, 0.25e-3, 0.1 * kDegree, 0.1, random)),
              testing::HasSubstr("about a second axis"));
  truth.one_axis = false;
  truth.largest_tilt = 2 * kDegree;
  EXPECT_THAT(refusal(truth, truth.views(20, 0.25e-3, 0.1 * kDegree, 0.1, random)),
              testing::HasSubstr("add views turned about other axes"));
}

TEST(HandEye, RefusesPosesOfTheWrongDirection) {
  std::mt19937 random(3);
  const SimulatedHandEye truth;
  auto views = truth.views(20, 0.25e-3, 0.1 * kDegree, 0.1, random);
  for (auto& view : views) view.T_reference_microscope = view.T_reference_microscope.inv();
  EXPECT_THAT(refusal(truth, views), testing::HasSubstr("not the inverse"));
}

/// As the tool says it.
std::string verdictOf(const SimulatedHandEye& truth, const std::vector<HandEyeView>& views,
                      const HandEyeSettings& settings = {}) {
  try {
    return judgeHandEye(calibrateHandEye(truth.left, truth.board, views, settings)).line();
  } catch (const CalibrationError& fault) {
    return std::string("verdict: useless: ") + fault.what();
  }
}

TEST(HandEyeVerdict, SaysWhatIsMissing) {
  SimulatedHandEye truth;
  std::mt19937 random(7);
  EXPECT_EQ(verdictOf(truth, truth.views(40, 0.1e-3, 0.04 * kDegree, 0.1, random)), "verdict: good");
  truth.largest_tilt = 11 * kDegree;
  EXPECT_THAT(verdictOf(truth, truth.views(40, 0.1e-3, 0.04 * kDegree, 0.1, random)),
              testing::AllOf(testing::StartsWith("verdict: doubtful: "), testing::HasSubstr("about a second axis")));
  truth.largest_tilt = 2 * kDegree;
  EXPECT_THAT(verdictOf(truth, truth.views(20, 0.1e-3, 0.04 * kDegree, 0.1, random)),
              testing::AllOf(testing::StartsWith("verdict: useless: "), testing::HasSubstr("about a second axis")));
  truth.largest_tilt = 30 * kDegree;
  HandEyeSettings coarse;  // a tracker that is known to be a poor one
  coarse.tracker_position_sd = 2e-3;
  coarse.tracker_rotation_sd = 1 * kDegree;
  EXPECT_THAT(verdictOf(truth, truth.views(8, 2e-3, 1 * kDegree, 0.1, random), coarse),
              testing::AllOf(testing::StartsWith("verdict: useless: "), testing::HasSubstr("take more views")));
  HandEyeSettings precise;  // a tracker that is said to be better than it is
  precise.tracker_position_sd = 0.08e-3;
  precise.tracker_rotation_sd = 0.03 * kDegree;
  EXPECT_THAT(verdictOf(truth, truth.views(30, 0.25e-3, 0.1 * kDegree, 0.1, random), precise),
              testing::HasSubstr("times the tracker's accuracy"));
}

TEST(HandEyeVerdict, AWrongSquareAndSwappedImagesAreUseless) {
  SimulatedHandEye truth;
  std::mt19937 random(8);
  auto views = truth.views(20, 0.1e-3, 0.04 * kDegree, 0.1, random);
  truth.board.square = 0.012;
  EXPECT_THAT(verdictOf(truth, views),
              testing::AllOf(testing::StartsWith("verdict: useless: "), testing::HasSubstr("side of a square right")));
  truth.board.square = 0.006;
  for (std::size_t i = 0; i + 1 < views.size(); i += 2) std::swap(views[i].corners, views[i + 1].corners);
  EXPECT_THAT(verdictOf(truth, views), testing::StartsWith("verdict: useless: "));
}

/// The camera's lens is what its file says, whatever it is.
TEST(HandEye, IsExactThroughAFisheye) {
  SimulatedHandEye truth;
  truth.left.lens = LensModel::kEquidistant;
  truth.left.D = {-0.1, 0.3, 0, 0};
  std::mt19937 random(9);
  const auto result = calibrateHandEye(truth.left, truth.board, truth.views(12, 0, 0, 0, random));
  EXPECT_LT(errorsOf(truth, result.T_microscope_left).translation, 1e-7);
}

TEST(HandEye, RefusesTooFewViewsAndABoardWithoutEnds) {
  std::mt19937 random(4);
  SimulatedHandEye truth;
  EXPECT_THAT(refusal(truth, truth.views(4, 0, 0, 0, random)), testing::HasSubstr("only 4 usable views"));
  truth.board.corners = {8, 6};
  EXPECT_THAT(refusal(truth, truth.views(12, 0, 0, 0, random)), testing::HasSubstr("upside down"));
}

}  // namespace
}  // namespace cortshift_stereo
