#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "analytic_scene.hpp"
#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/shift.hpp"

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

TEST_F(Shift, SameBitsForOneAndTwoThreads) {
  const PinholeCamera small = scene.cameraAt(0.3, 0.05, 0, 0, {240, 180}, 0.02);
  const auto earlier = scene.see(small, AnalyticScene::atRest()), later = scene.see(small, sagAndShift(0.002, 0.0005));
  ShiftSettings one, two;
  one.setThreads(1);
  two.setThreads(2);
  const ShiftResult a = computeShift(earlier, later, directions(earlier), one),
                    b = computeShift(earlier, later, directions(earlier), two);
  ASSERT_EQ(a.field.displacement_pmr.size(), b.field.displacement_pmr.size());
  EXPECT_EQ(std::memcmp(a.field.displacement_pmr.data, b.field.displacement_pmr.data,
                        a.field.displacement_pmr.total() * sizeof(cv::Vec3f)),
            0);
}

TEST_F(Shift, SurfacesThatDoNotMeetAreRefused) {
  const PinholeCamera small = scene.cameraAt(0.3, 0, 0, 0, {120, 90}, 0.01);
  const auto earlier = scene.see(small, AnalyticScene::atRest());
  auto later = earlier;
  later.points = cv::Mat(earlier.points + cv::Scalar(0.1, 0.1, 0.1));  // a buffer of its own
  EXPECT_THROW(computeShift(earlier, later, directions(earlier)), TrackingError);
}

TEST(ShiftSettings, OutOfRangeValuesAreNamed) {
  ShiftSettings settings;
  settings.registration.channels = "red";
  try {
    settings.validate();
    FAIL();
  } catch (const TrackingError& error) {
    EXPECT_NE(std::string(error.what()).find("channels = 'red'"), std::string::npos);
  }
}

}  // namespace
}  // namespace cortshift_tracking
