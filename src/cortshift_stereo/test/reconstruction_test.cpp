// The core on scenes with known truth: accuracy on any geometry, and pairs that must be refused.
#include "cortshift_stereo/reconstruction.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "analytic_scene.hpp"
#include "cortshift_stereo/averaging/frame_average.hpp"
#include "cortshift_stereo/refinement/refinement.hpp"

namespace cortshift_stereo {
namespace {

using cortshift_stereo_test::AnalyticScene;

struct Accuracy {
  double median_px, p95_px, coverage;
};

/// Errors of the disparity that belongs to the true depth.
Accuracy accuracyOf(const AnalyticScene& scene, const cv::Mat& disparity) {
  const StereoModel model = scene.model();
  const cv::Mat depth = scene.trueDepth();
  std::vector<double> errors;
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x) {
      const float d = disparity.at<float>(y, x);
      const double truth =
          scene.focal * scene.baseline / depth.at<float>(y, x) + model.left.P(0, 2) - model.right.P(0, 2);
      if (!std::isnan(d)) errors.push_back(std::abs(d - truth));
    }
  if (errors.empty()) return {1e9, 1e9, 0};
  std::sort(errors.begin(), errors.end());
  return {errors[errors.size() / 2], errors[errors.size() * 95 / 100],
          static_cast<double>(errors.size()) / static_cast<double>(depth.total())};
}

ReconstructionResult reconstructScene(const AnalyticScene& scene, const ReconstructionSettings& settings = {}) {
  return reconstruct(scene.left(), scene.right(), Rectifier(scene.model()), settings);
}

void expectAccurate(const AnalyticScene& scene, double median, double p95, double coverage,
                    const ReconstructionSettings& settings = {}) {
  const ReconstructionResult result = reconstructScene(scene, settings);
  const Accuracy accuracy = accuracyOf(scene, result.disparity);
  EXPECT_LT(accuracy.median_px, median);
  EXPECT_LT(accuracy.p95_px, p95);
  EXPECT_GT(accuracy.coverage, coverage);
  EXPECT_NEAR(result.quality.coverage, accuracy.coverage / Rectifier(scene.model()).leftShare(), 1e-9);
}

std::string refusalOf(const AnalyticScene& scene, const cv::Mat& left, const cv::Mat& right) {
  try {
    reconstruct(left, right, Rectifier(scene.model()));
    return "accepted";
  } catch (const PairError& error) {
    EXPECT_GT(std::string(error.what()).size(), 40u) << "a reason must be a sentence with a remedy";
    return error.reason();
  }
}

TEST(Reconstruction, vergingCamerasWithDistortion) { expectAccurate({}, 0.03, 0.12, 0.75); }

TEST(Reconstruction, parallelPrincipalPoints) {
  AnalyticScene scene;
  scene.equal_principal_points = true;
  scene.vergence = 0;
  scene.baseline = 0.010;
  expectAccurate(scene, 0.03, 0.12, 0.5);
}

TEST(Reconstruction, anotherWorkingDistanceAndBaseline) {
  AnalyticScene scene;
  scene.depth = 0.450;
  scene.baseline = 0.040;
  scene.vergence = 0.04;
  expectAccurate(scene, 0.03, 0.12, 0.75);
  scene.depth = 0.220;
  scene.baseline = 0.015;
  scene.vergence = 0.03;
  expectAccurate(scene, 0.03, 0.12, 0.75);
}

TEST(Reconstruction, disparitiesOfBothSigns) {
  AnalyticScene scene;
  scene.slope = {0.9, 0.2};
  const ReconstructionResult result = reconstructScene(scene);
  EXPECT_LT(result.quality.search_range.start, -4);
  EXPECT_GT(result.quality.search_range.end, 4);
  EXPECT_LT(accuracyOf(scene, result.disparity).median_px, 0.04);
}

TEST(Reconstruction, sameBitsFromOneThreadAndTwo) {
  AnalyticScene scene;
  scene.noise = 2;
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const ReconstructionResult one = reconstructScene(scene);
  cv::setNumThreads(2);
  const ReconstructionResult two = reconstructScene(scene);
  cv::setNumThreads(threads);
  const auto same = [](const cv::Mat& a, const cv::Mat& b) {
    return a.isContinuous() && b.isContinuous() && a.size() == b.size() && a.type() == b.type() &&
           std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
  };
  EXPECT_TRUE(same(one.disparity, two.disparity));
  EXPECT_TRUE(same(one.surface_left.points, two.surface_left.points));
  EXPECT_TRUE(same(one.surface_left.colour, two.surface_left.colour));
  EXPECT_TRUE(same(one.surface_left.confidence, two.surface_left.confidence));
}

TEST(Reconstruction, noiseGainAndOffset) {
  AnalyticScene scene;
  scene.noise = 4;
  expectAccurate(scene, 0.06, 0.25, 0.75);
  scene.right_gain = 0.85;
  scene.right_offset = 8;
  expectAccurate(scene, 0.08, 0.35, 0.75);
}

TEST(Reconstruction, refinementRemovesPixelLocking) {
  const AnalyticScene scene;
  const Rectifier rectifier(scene.model());
  const RectifiedPair pair = rectifier.rectify(scene.left(), scene.right());
  const cv::Mat start = matchSemiGlobal(pair.left_sharp, pair.right_sharp, {-32, 32});
  const Accuracy before = accuracyOf(scene, start);
  cv::Mat refined = refineDisparity(pair, start).disparity;
  EXPECT_EQ(accuracyOf(scene, refined).coverage, 1) << "also where the start was unknown";
  refined.setTo(std::numeric_limits<float>::quiet_NaN(), ~(start == start));
  EXPECT_LT(accuracyOf(scene, refined).median_px, 0.3 * before.median_px);
}

TEST(Reconstruction, pointsAreInTheRawLeftFrame) {
  const AnalyticScene scene;
  const ReconstructionResult result = reconstructScene(scene);
  const StereoModel model = scene.model();
  const cv::Mat depth = scene.trueDepth();
  int checked = 0;
  for (int y = 40; y < 200; y += 20)
    for (int x = 40; x < 280; x += 20) {
      const cv::Vec3f p = result.surface_left.points.at<cv::Vec3f>(y, x);
      if (std::isnan(p[0])) continue;
      // Rotated into the rectified frame, the point must project to its own pixel.
      const cv::Vec3d q = model.left.R * cv::Vec3d(p);
      EXPECT_NEAR(model.left.P(0, 0) * q[0] / q[2] + model.left.P(0, 2), x, 1e-3);
      EXPECT_NEAR(model.left.P(1, 1) * q[1] / q[2] + model.left.P(1, 2), y, 1e-3);
      EXPECT_NEAR(q[2], depth.at<float>(y, x), 2e-3);
      ++checked;
    }
  EXPECT_GT(checked, 50);
}

TEST(Reconstruction, oneThreadGivesTheBitsOfMany) {
  const AnalyticScene scene;
  const int threads = cv::getNumThreads();
  const cv::Mat many = reconstructScene(scene).disparity;
  cv::setNumThreads(1);
  const cv::Mat one = reconstructScene(scene).disparity;
  cv::setNumThreads(threads);
  EXPECT_EQ(std::memcmp(many.data, one.data, many.total() * many.elemSize()), 0);
}

TEST(Reconstruction, saturatedPixelsGiveNoPoint) {
  const AnalyticScene scene;
  cv::Mat left = scene.left();
  const cv::Rect highlight(140, 100, 40, 30);
  left(highlight).setTo(cv::Scalar::all(255));
  const ReconstructionResult result = reconstruct(left, scene.right(), Rectifier(scene.model()));
  const Accuracy accuracy = accuracyOf(scene, result.disparity);
  EXPECT_LT(accuracy.p95_px, 0.2);
  // The highlight moves by a few pixels in rectification; its middle stays inside.
  EXPECT_EQ(
      cv::countNonZero(result.disparity(cv::Rect(152, 110, 14, 8)) == result.disparity(cv::Rect(152, 110, 14, 8))), 0);
}

/// Adds the lamp's white light, saturated in the middle, with its glow.
void addHighlight(cv::Mat& bgr, const cv::Point2d& centre) {
  constexpr double kStrength = 250, kWidth = 3;  // [grey levels], [px]
  for (int y = 0; y < bgr.rows; ++y)
    for (int x = 0; x < bgr.cols; ++x) {
      const cv::Point2d away = cv::Point2d(x, y) - centre;
      const double light = kStrength * std::exp(-away.dot(away) / (2 * kWidth * kWidth));
      for (int channel = 0; channel < 3; ++channel) {
        uint8_t& value = bgr.at<cv::Vec3b>(y, x)[channel];
        value = cv::saturate_cast<uint8_t>(value + light);
      }
    }
}

TEST(Reconstruction, highlightsAtAnotherDepthDoNotMislead) {
  const AnalyticScene scene;
  cv::Mat left = scene.left(), right = scene.right();
  cv::RNG random(5);
  constexpr double kMirrorImage = 9;  // [px] of disparity besides the surface's
  for (int i = 0; i < 40; ++i) {
    const cv::Point2d at(random.uniform(20.0, 300.0), random.uniform(20.0, 220.0));
    addHighlight(left, at);
    addHighlight(right, at + cv::Point2d(kMirrorImage, 0));
  }
  const Rectifier rectifier(scene.model());
  const ReconstructionResult result = reconstruct(left, right, rectifier);
  const Accuracy accuracy = accuracyOf(scene, result.disparity);
  EXPECT_LT(accuracy.p95_px, 0.25);
  EXPECT_GT(accuracy.coverage, 0.65);
  const cv::Mat hidden = ~rectifier.rectify(left, right).left_seen;
  EXPECT_GT(cv::countNonZero(hidden), 1000);
  EXPECT_EQ(cv::countNonZero(hidden & (result.disparity == result.disparity)), 0);
}

TEST(Reconstruction, pairsWithoutASurfaceAreRefusedByName) {
  const AnalyticScene scene;
  const cv::Mat left = scene.left(), right = scene.right();
  EXPECT_EQ(refusalOf(scene, left, right), "accepted");
  EXPECT_EQ(refusalOf(scene, right, left), "swapped");
  EXPECT_EQ(refusalOf(scene, cv::Mat(left.size(), CV_8UC3, cv::Scalar::all(90)), right), "blank");
  cv::Mat bright;
  left.convertTo(bright, -1, 2.5);
  EXPECT_EQ(refusalOf(scene, bright, right), "saturated");
  cv::Mat small;
  cv::resize(left, small, {}, 0.5, 0.5);
  EXPECT_EQ(refusalOf(scene, small, right), "image_size");
  AnalyticScene bad;
  bad.blur = 8;
  EXPECT_EQ(refusalOf(bad, bad.left(), bad.right()), "defocused");
  bad = {};
  bad.right_rows_down = 6;
  EXPECT_EQ(refusalOf(bad, bad.left(), bad.right()), "epipolar");
}

TEST(Reconstruction, tooLittleCoverageIsRefusedByName) {
  const AnalyticScene scene;
  ReconstructionSettings settings;
  settings.limits.min_coverage = 1;
  try {
    reconstructScene(scene, settings);
    FAIL();
  } catch (const PairError& error) {
    EXPECT_EQ(error.reason(), "coverage");
    EXPECT_NE(std::string(error.what()).find("at least 100 % is needed"), std::string::npos) << error.what();
  }
}

TEST(Reconstruction, imagesOfDifferentScenesAreRefused) {
  const AnalyticScene scene;
  cv::Mat other;
  cv::flip(scene.right(), other, 0);
  EXPECT_NE(refusalOf(scene, scene.left(), other), "accepted");
}

TEST(Reconstruction, aSceneOutsideTheWorkingDistancesIsRefused) {
  AnalyticScene scene;
  ReconstructionSettings settings;
  settings.min_working_distance = 0.05;
  settings.max_working_distance = 0.15;
  EXPECT_THROW(reconstructScene(scene, settings), PairError);
}

TEST(Reconstruction, settingsOutOfRangeAreNamed) {
  ReconstructionSettings settings;
  settings.max_working_distance = 0.1;
  try {
    settings.validate();
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("max_working_distance = 0.1"), std::string::npos) << error.what();
  }
}

TEST(Reconstruction, theRangeFollowsFromTheWorkingDistances) {
  const StereoModel model = AnalyticScene().model();
  const SearchRange range = possibleRange(model, 0.2, 0.4);
  EXPECT_LE(depthOfDisparity(model, range.end), 0.2);
  EXPECT_GE(depthOfDisparity(model, range.start), 0.4);
  EXPECT_NEAR(depthOfDisparity(model, range.end), 0.2, 0.003);
  EXPECT_NEAR(depthOfDisparity(model, range.start), 0.4, 0.01);
}

TEST(FrameAverage, outliersAndHolesDoNotCount) {
  const AnalyticScene scene;
  const StereoModel model = scene.model();
  std::vector<Frame> frames;
  for (int i = 0; i < 5; ++i)
    frames.push_back({cv::Mat(scene.size, CV_32FC1, cv::Scalar(2.0 + 0.01 * i)),
                      cv::Mat(scene.size, CV_8UC3, cv::Scalar::all(10 * i)),
                      cv::Mat(scene.size, CV_32FC1, cv::Scalar(0.5))});
  const float nan = std::numeric_limits<float>::quiet_NaN();
  frames[1].disparity.at<float>(5, 5) = 7;  // an outlier
  for (int i = 0; i < 2; ++i)
    frames[static_cast<std::size_t>(i)].disparity.at<float>(6, 6) = nan;  // a minority of holes
  for (int i = 0; i < 3; ++i) frames[static_cast<std::size_t>(i)].disparity.at<float>(7, 7) = nan;  // a majority
  const ReconstructionResult mean = averageFrames(frames, model);
  EXPECT_NEAR(mean.disparity.at<float>(50, 50), 2.02, 1e-5);
  EXPECT_NEAR(mean.disparity.at<float>(5, 5), (2.0 + 2.02 + 2.03 + 2.04) / 4, 1e-5);
  EXPECT_NEAR(mean.disparity.at<float>(6, 6), 2.03, 1e-5);
  EXPECT_TRUE(std::isnan(mean.disparity.at<float>(7, 7)));
  EXPECT_EQ(mean.surface_left.confidence.at<float>(7, 7), 0);
  EXPECT_GT(mean.surface_left.confidence.at<float>(50, 50), 0.5) << "five frames promise more than one";
  EXPECT_EQ(mean.surface_left.colour.at<cv::Vec3b>(50, 50), cv::Vec3b(20, 20, 20));
  EXPECT_NEAR(depthOfDisparity(model, 2.02),
              (model.left.R * cv::Vec3d(mean.surface_left.points.at<cv::Vec3f>(50, 50)))[2], 1e-6);
}

TEST(FrameAverage, coloursAreAveragedPixelByPixel) {
  const AnalyticScene scene;
  std::vector<Frame> frames(2);
  for (std::size_t i = 0; i < 2; ++i) {
    frames[i] = {cv::Mat(scene.size, CV_32FC1, cv::Scalar(2)), cv::Mat(scene.size, CV_8UC3),
                 cv::Mat(scene.size, CV_32FC1, cv::Scalar(0.5))};
    for (int y = 0; y < scene.size.height; ++y)
      for (int x = 0; x < scene.size.width; ++x)
        frames[i].colour.at<cv::Vec3b>(y, x) =
            cv::Vec3b(static_cast<uint8_t>(x / 2), static_cast<uint8_t>(y), i ? 40 : 20);
  }
  const cv::Mat colour = averageFrames(frames, scene.model()).surface_left.colour;
  EXPECT_EQ(colour.at<cv::Vec3b>(33, 210), cv::Vec3b(105, 33, 30));
  EXPECT_EQ(colour.at<cv::Vec3b>(200, 12), cv::Vec3b(6, 200, 30));
}

TEST(FrameAverage, noiseOfTheMeanIsWhatTheFramesPromiseOrShow) {
  const AnalyticScene scene;
  const auto deviationOfMean = [&](float step, float confidence) {
    std::vector<Frame> frames;
    for (int i = 0; i < 4; ++i)
      frames.push_back({cv::Mat(scene.size, CV_32FC1, cv::Scalar(2 + step * static_cast<float>(i))),
                        cv::Mat(scene.size, CV_8UC3, cv::Scalar::all(0)),
                        cv::Mat(scene.size, CV_32FC1, cv::Scalar(confidence))});
    return deviationOf(averageFrames(frames, scene.model()).surface_left.confidence.at<float>(50, 50));
  };
  EXPECT_NEAR(deviationOfMean(0, 0.5F), 0.1 / 2, 1e-4);  // four that promise 0.1 px each
  // Four that lie 0.1 px apart: variance 5/3 of a hundredth, of the mean a quarter of it.
  EXPECT_NEAR(deviationOfMean(0.1F, 0.99F), std::sqrt(0.05 / 3 / 4), 1e-3);
}

TEST(Confidence, roundTrip) {
  for (const double deviation : {0.01, 0.1, 0.7}) {
    const cv::Mat confidence = confidenceOf(cv::Mat(1, 1, CV_32FC1, cv::Scalar(deviation)));
    EXPECT_NEAR(deviationOf(confidence.at<float>(0, 0)), deviation, 1e-5);
  }
}

}  // namespace
}  // namespace cortshift_stereo
