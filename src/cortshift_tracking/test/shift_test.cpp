#include "cortshift_tracking/shift.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "analytic_scene.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kDegree = M_PI / 180;
const cv::Size kImage(560, 420);
constexpr double kField = 0.045;  // 0.08 mm between pixels

struct Errors {
  double median, p95, coverage;
};

Errors errorsOf(const ShiftResult& result, const AnalyticScene& scene, const AnalyticScene::Deformation& from,
                const AnalyticScene::Deformation& to) {
  std::vector<double> errors;
  for (int row = 0; row < result.field.start_pmr.rows; ++row)
    for (int column = 0; column < result.field.start_pmr.cols; ++column) {
      const cv::Vec3f p = result.field.start_pmr.at<cv::Vec3f>(row, column),
                      d = result.field.displacement_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(p[0])) continue;
      const Eigen::Vector3d truth = scene.displacement_pmr({p[0], p[1], p[2]}, from, to);
      errors.push_back((truth - Eigen::Vector3d(d[0], d[1], d[2])).norm());
    }
  std::sort(errors.begin(), errors.end());
  const Errors out{errors[errors.size() / 2], errors[errors.size() * 95 / 100],
                   static_cast<double>(errors.size()) / cv::countNonZero(result.earlier.mask & result.later.mask)};
  std::printf("median %.4f mm, 95 %% %.4f mm, reported %.1f %%; %s\n", 1e3 * out.median, 1e3 * out.p95,
              1e2 * out.coverage, toText(result.summary).c_str());
  return out;
}

class Shift : public testing::Test {
 protected:
  static Directions directions(const cortshift_stereo::Surface& first) { return {averageNormal(first), std::nullopt}; }

  AnalyticScene scene = standardScene();
  PinholeCamera camera = scene.cameraAt(0.3, 0, 0, 0, kImage, kField);
  PinholeCamera moved = scene.cameraAt(0.305, 10 * kDegree, 0.004, 15 * kDegree, kImage, kField);
};

// Exact surfaces: what tracking alone adds. The bars are 0.04 / 0.12 mm with the reconstruction's error in.
TEST_F(Shift, SagAndLateralShiftFromAnotherPose) {
  const auto deformation = sagAndShift(0.006, 0.002);
  const auto earlier = scene.see(camera, AnalyticScene::atRest()), later = scene.see(moved, deformation);
  const ShiftResult result = computeShift(earlier, later, directions(earlier));
  const Errors errors = errorsOf(result, scene, AnalyticScene::atRest(), deformation);
  EXPECT_LT(errors.median, 0.00002);
  EXPECT_LT(errors.p95, 0.0001);
  EXPECT_GT(errors.coverage, 0.7);
  EXPECT_LT(result.summary.normal.mean, -0.001);  // it sags
  EXPECT_GT(result.summary.overlap, 0.8);
}

TEST_F(Shift, StaticSceneFromTwoPoses) {
  const auto earlier = scene.see(camera, AnalyticScene::atRest()), later = scene.see(moved, AnalyticScene::atRest());
  const ShiftResult result = computeShift(earlier, later, directions(earlier));
  const Errors errors = errorsOf(result, scene, AnalyticScene::atRest(), AnalyticScene::atRest());
  EXPECT_LT(errors.median, 0.00001);
  EXPECT_LT(errors.p95, 0.00005);
  EXPECT_GT(errors.coverage, 0.7);
}

/// Light that changes across the image, as when the lamp moves or the surface leans away from it.
cortshift_stereo::Surface shaded(const cortshift_stereo::Surface& surface) {
  cortshift_stereo::Surface result = surface;
  result.colour = surface.colour.clone();
  for (int row = 0; row < result.colour.rows; ++row)
    for (int column = 0; column < result.colour.cols; ++column) {
      const double light = 0.75 + 0.25 * std::sin(0.02 * column) * std::cos(0.015 * row);
      cv::Vec3b& c = result.colour.at<cv::Vec3b>(row, column);
      for (int i = 0; i < 3; ++i) c[i] = cv::saturate_cast<uchar>(light * c[i]);
    }
  return result;
}

TEST_F(Shift, ChangedShadingDoesNotMoveTheField) {
  const auto deformation = sagAndShift(0.003, 0.001);
  const auto earlier = scene.see(camera, AnalyticScene::atRest()), later = shaded(scene.see(moved, deformation));
  const ShiftResult result = computeShift(earlier, later, directions(earlier));
  const Errors errors = errorsOf(result, scene, AnalyticScene::atRest(), deformation);
  EXPECT_LT(errors.median, 0.00002);
  EXPECT_LT(errors.p95, 0.0001);
  EXPECT_GT(errors.coverage, 0.7);
}

TEST_F(Shift, WhatIsDrawnBesideTheStageIsRefused) {
  ShiftSettings settings;
  settings.frame.resolution = 0.0004;
  const auto earlier = scene.see(camera, AnalyticScene::atRest()), later = scene.see(moved, sagAndShift(0.003, 0.001));
  const Region beside{{0.2, 0.2}, {0.25, 0.2}, {0.25, 0.25}}, on_it{{0.012, 0.008}, {0.033, 0.008}, {0.02, 0.025}};
  const auto refusal = [&](const std::vector<Region>& excluded, const std::vector<Region>& brain) -> std::string {
    PairKnowledge knowledge;
    knowledge.brain = brain;
    try {
      computeShift(earlier, later, directions(earlier), settings, excluded, knowledge);
    } catch (const TrackingError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal({on_it}, {on_it}), "");
  EXPECT_THAT(
      refusal({on_it, beside}, {}),
      testing::StartsWith("excluded region 2 of 2 lies nowhere on the earlier stage; give the regions again with "
                          "exclude_regions, in metres of its projection frame"));
  EXPECT_THAT(refusal({}, {beside}), testing::StartsWith("the outline that was drawn of the brain covers 0 mm2 of the "
                                                         "earlier stage's surface; draw it again with set_outline"));
}

TEST_F(Shift, APredictionIsAStartAndNoMore) {
  ShiftSettings settings;
  settings.frame.resolution = 0.0002;  // as in live mode
  const auto deformation = sagAndShift(0.004, 0.0015);
  const auto earlier = scene.see(camera, AnalyticScene::atRest()), later = scene.see(moved, deformation);
  const Reference reference = prepareReference(earlier, settings);
  const ShiftResult cold = computeShift(reference, later, directions(earlier), settings);
  const cv::Mat prediction = predictionOf(cold.flow, cold.field.confidence),
                wrong(cold.flow.size(), CV_32FC2, cv::Scalar(5, -4));
  for (const cv::Mat& start : {prediction, wrong}) {
    const ShiftResult warm = computeShift(reference, later, directions(earlier), settings, start);
    const Errors errors = errorsOf(warm, scene, AnalyticScene::atRest(), deformation);
    EXPECT_LT(errors.median, 0.00003);
    EXPECT_LT(errors.p95, 0.00015);
    EXPECT_GT(errors.coverage, 0.7);
  }
}

/// Only blue still shows the tissue, as under blood (Ji et al. 2014, Discussion): the other channels see something
/// else.
cortshift_stereo::Surface bled(const cortshift_stereo::Surface& surface) {
  cortshift_stereo::Surface result = surface;
  cv::Mat other(surface.colour.size(), CV_8UC3);
  cv::RNG random(20140317);
  random.fill(other, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(other, other, cv::Size(), 3);
  cv::normalize(other, other, 20, 235, cv::NORM_MINMAX);
  result.colour = surface.colour.clone();
  const int from_to[] = {1, 1, 2, 2};  // green, red
  cv::mixChannels(&other, 1, &result.colour, 1, from_to, 2);
  return result;
}

TEST_F(Shift, ChannelsAreChosenWithAPredictionToo) {
  ShiftSettings settings;
  settings.frame.resolution = 0.0002;  // as in live mode
  const auto before = sagAndShift(0.003, 0.001), now = sagAndShift(0.004, 0.0015);
  const auto earlier = scene.see(camera, AnalyticScene::atRest());
  const Reference reference = prepareReference(earlier, settings);
  const ShiftResult clean = computeShift(reference, scene.see(moved, before), directions(earlier), settings);
  const ShiftResult warm = computeShift(reference, bled(scene.see(moved, now)), directions(earlier), settings,
                                        predictionOf(clean.flow, clean.field.confidence));
  const Errors errors = errorsOf(warm, scene, AnalyticScene::atRest(), now);
  EXPECT_LT(errors.median, 0.00003);
  EXPECT_LT(errors.p95, 0.00015);
  EXPECT_GT(errors.coverage, 0.6);
}

// Larger than what is searched after the first looks: the last one finds it only if it is told the whole of it.
TEST_F(Shift, AMotionAsWideAsTheSearchIsFound) {
  const auto aside = [](double, double) { return Eigen::Vector3d(0.005, -0.003, 0); };
  const PinholeCamera wide = scene.cameraAt(0.3, 0, 0, 0, {360, 300}, 0.036);
  const auto earlier = scene.see(wide, AnalyticScene::atRest()), later = scene.see(wide, aside);
  const ShiftResult result = computeShift(earlier, later, directions(earlier));
  const Errors errors = errorsOf(result, scene, AnalyticScene::atRest(), aside);
  EXPECT_LT(errors.median, 0.00002);
  EXPECT_LT(errors.p95, 0.0001);
  EXPECT_GT(errors.coverage, 0.5);
}

TEST_F(Shift, OneFirstLookFindsMostOfALargeMotion) {
  ShiftSettings settings;
  settings.matching.coarse_rounds = 1;
  const auto aside = [](double, double) { return Eigen::Vector3d(0.005, -0.003, 0); };
  const PinholeCamera wide = scene.cameraAt(0.3, 0, 0, 0, {360, 300}, 0.036);
  const auto earlier = scene.see(wide, AnalyticScene::atRest()), later = scene.see(wide, aside);
  const ShiftResult result = computeShift(earlier, later, directions(earlier), settings);
  const Errors errors = errorsOf(result, scene, AnalyticScene::atRest(), aside);
  EXPECT_LT(errors.median, 0.00002);
  EXPECT_GT(errors.coverage, 0.5);
}

TEST_F(Shift, OwnPointsAgreeWithTheField) {
  ShiftSettings settings;
  settings.with_own_points = true;
  settings.frame.resolution = 0.0002;
  const auto deformation = sagAndShift(0.003, 0.001);
  const auto earlier = scene.see(camera, AnalyticScene::atRest()), later = scene.see(moved, deformation);
  const ShiftResult result = computeShift(earlier, later, directions(earlier), settings);
  ASSERT_EQ(result.own_displacements_pmr.size(), earlier.points.size());
  std::vector<double> errors;
  for (int row = 0; row < earlier.points.rows; row += 4)
    for (int column = 0; column < earlier.points.cols; column += 4) {
      const cv::Vec3f d = result.own_displacements_pmr.at<cv::Vec3f>(row, column),
                      p = result.own_points_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(d[0])) continue;
      const Eigen::Vector3d truth = scene.displacement_pmr({p[0], p[1], p[2]}, AnalyticScene::atRest(), deformation);
      errors.push_back((truth - Eigen::Vector3d(d[0], d[1], d[2])).norm());
    }
  ASSERT_GT(errors.size(), 5000U);
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.00003);
  EXPECT_LT(errors[errors.size() * 95 / 100], 0.00015);
}

TEST_F(Shift, SameBitsForOneAndTwoThreadsAndFromRunToRun) {
  const PinholeCamera small = scene.cameraAt(0.3, 0.05, 0, 0, {240, 180}, 0.02);
  const auto earlier = scene.see(small, AnalyticScene::atRest()), later = scene.see(small, sagAndShift(0.002, 0.0005));
  const auto bytesOf = [&](int threads) {
    ShiftSettings settings;
    settings.setThreads(threads);
    settings.with_strain = settings.with_own_points = true;
    const ShiftResult result = computeShift(earlier, later, directions(earlier), settings);
    std::string bytes;
    for (const cv::Mat& image : {result.field.start_pmr, result.field.displacement_pmr, result.field.confidence,
                                 result.field.strain_major, result.own_displacements_pmr, result.flow})
      bytes.append(reinterpret_cast<const char*>(image.data), image.total() * image.elemSize());
    return bytes;
  };
  const std::string once = bytesOf(1);
  EXPECT_TRUE(once == bytesOf(2));
  EXPECT_TRUE(once == bytesOf(2));
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);  // what OpenCV's own filters use
  EXPECT_TRUE(once == bytesOf(1));
  cv::setNumThreads(threads);
}

// A live reference serves many times: what the looks leave out for one later stage must not be missing for the next.
TEST_F(Shift, AReferenceServesAgainUnchanged) {
  const PinholeCamera small = scene.cameraAt(0.3, 0.05, 0, 0, {480, 360}, 0.04);
  const auto earlier = scene.see(small, AnalyticScene::atRest());
  auto later = scene.see(small, sagAndShift(0.002, 0.0005));
  later.colour = later.colour.clone();
  cv::RNG random(5);
  random.fill(later.colour(cv::Rect(0, 0, 240, 360)), cv::RNG::UNIFORM, 60, 200);  // nothing to find in this half
  const Reference reference = prepareReference(earlier, {});
  const cv::Mat usable = reference.usable.clone();
  const ShiftResult once = computeShift(reference, later, directions(earlier), {}),
                    again = computeShift(reference, later, directions(earlier), {});
  EXPECT_EQ(cv::norm(reference.usable, usable, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(once.flow, again.flow, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(once.field.confidence, again.field.confidence, cv::NORM_INF), 0);
}

TEST_F(Shift, SurfacesThatDoNotMeetAreRefused) {
  const PinholeCamera small = scene.cameraAt(0.3, 0, 0, 0, {120, 90}, 0.01);
  const auto earlier = scene.see(small, AnalyticScene::atRest());
  auto later = earlier;
  later.points = cv::Mat(earlier.points + cv::Scalar(0.1, 0.1, 0.1));  // a buffer of its own
  EXPECT_THROW(computeShift(earlier, later, directions(earlier)), TrackingError);
}

std::string refusal(const ShiftSettings& settings) {
  try {
    settings.validate();
  } catch (const TrackingError& error) {
    return error.what();
  }
  return "";
}

TEST(ShiftSettings, OutOfRangeValuesAreNamedWithWhatIsAllowed) {
  EXPECT_EQ(refusal({}), "");
  ShiftSettings settings;
  settings.matching.channels = "red";
  EXPECT_THAT(refusal(settings), testing::HasSubstr("channels = 'red'"));

  const std::pair<double& (*)(ShiftSettings&), const char*> ranges[] = {
      {[](ShiftSettings& s) -> double& { return s.frame.resolution; }, "resolution|5e-05 ... 0.001"},
      {[](ShiftSettings& s) -> double& { return s.frame.margin; }, "margin|0 ... 0.02"},
      {[](ShiftSettings& s) -> double& { return s.projection.max_edge_ratio; }, "max_edge_ratio|2 ... 50"},
      {[](ShiftSettings& s) -> double& { return s.projection.fold_tolerance; }, "fold_tolerance|0 ... 0.01"},
      {[](ShiftSettings& s) -> double& { return s.matching.detail; }, "detail|0.5 ... 100"},
      {[](ShiftSettings& s) -> double& { return s.matching.bend; }, "bend|0.01 ... 1000"},
      {[](ShiftSettings& s) -> double& { return s.matching.search; }, "search|0.001 ... 0.05"},
      {[](ShiftSettings& s) -> double& { return s.matching.coarse_resolution; }, "coarse_resolution|5e-05 ... 0.002"},
      {[](ShiftSettings& s) -> double& { return s.trust.border; }, "border|0 ... 0.02"},
      {[](ShiftSettings& s) -> double& { return s.trust.hole_border; }, "hole_border|0 ... 0.02"},
      {[](ShiftSettings& s) -> double& { return s.trust.glare; }, "glare|0.5 ... 1"},
      {[](ShiftSettings& s) -> double& { return s.trust.glare_margin; }, "glare_margin|0 ... 0.01"},
      {[](ShiftSettings& s) -> double& { return s.trust.agreement.window; }, "match_window|0.0005 ... 0.02"},
      {[](ShiftSettings& s) -> double& { return s.trust.agreement.image_noise; }, "image_noise|0 ... 0.2"},
      {[](ShiftSettings& s) -> double& { return s.inversion.min_confidence; }, "min_confidence|0 ... 1"},
      {[](ShiftSettings& s) -> double& { return s.surround.pose_translation_sd; }, "pose_translation_sd|0 ... 0.01"},
      {[](ShiftSettings& s) -> double& { return s.surround.pose_rotation_sd; }, "pose_rotation_sd|0 ... 0.1"},
      {[](ShiftSettings& s) -> double& { return s.surround.pose_latency_sd; }, "pose_latency_sd|0 ... 1"},
      {[](ShiftSettings& s) -> double& { return s.strain.window; }, "strain_window|0.0005 ... 0.02"},
  };
  for (const auto& [of, said] : ranges) {
    const std::string text = said;
    const std::size_t bar = text.find('|');
    for (double value : {-7.0, 7000.0}) {
      ShiftSettings wrong;
      of(wrong) = value;
      EXPECT_EQ(refusal(wrong), text.substr(0, bar) + (value < 0 ? " = -7" : " = 7000") +
                                    " is not allowed; allowed is " + text.substr(bar + 1));
    }
  }

  const std::pair<int& (*)(ShiftSettings&), const char*> counts[] = {
      {[](ShiftSettings& s) -> int& { return s.matching.coarse_rounds; },
       "coarse_rounds = -7 is not allowed; allowed is 0 ... 10"},
      {[](ShiftSettings& s) -> int& { return s.projection.threads; },
       "threads = -7 is not allowed; allowed is 0 ... 256"},
      {[](ShiftSettings& s) -> int& { return s.inversion.threads; },
       "threads = -7 is not allowed; allowed is 0 ... 256"},
      {[](ShiftSettings& s) -> int& { return s.strain.threads; }, "threads = -7 is not allowed; allowed is 0 ... 256"},
  };
  for (const auto& [of, said] : counts) {
    ShiftSettings wrong;
    of(wrong) = -7;
    EXPECT_EQ(refusal(wrong), said);
  }
}

}  // namespace
}  // namespace cortshift_tracking
