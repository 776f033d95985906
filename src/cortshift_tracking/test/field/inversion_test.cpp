#include "cortshift_tracking/field/inversion.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "analytic_scene.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kDegree = M_PI / 180;

/// Two states of the scene from two poses and the exact flow between their projections.
class Inversion : public testing::Test {
 protected:
  Inversion() {
    const auto earlier_surface = scene.see(scene.cameraAt(0.3, 0, 0, 0, {400, 300}, 0.032), AnalyticScene::atRest());
    const auto later_surface =
        scene.see(scene.cameraAt(0.31, 8 * kDegree, 0.002, 15 * kDegree, {400, 300}, 0.034), deformation);
    frame = fitProjectionFrame(earlier_surface);
    earlier = project(earlier_surface, frame);
    later = project(later_surface, frame);
    flow = cv::Mat(frame.size, CV_32FC2, cv::Scalar::all(0));
    confidence = cv::Mat(frame.size, CV_32FC1, cv::Scalar(1));
    confidence.setTo(0, earlier.mask == 0);
    points = earlier_surface.points;
    for (int row = 0; row < frame.size.height; ++row)
      for (int column = 0; column < frame.size.width; ++column) {
        if (earlier.mask.at<uchar>(row, column) == 0) continue;
        const Eigen::Vector3d p =
            frame.T_pmr_projection *
            Eigen::Vector3d(column * frame.resolution, row * frame.resolution, earlier.height.at<float>(row, column));
        const Eigen::Vector3d d = frame.T_pmr_projection.linear().transpose() *
                                  scene.displacement_pmr(p, AnalyticScene::atRest(), deformation) / frame.resolution;
        flow.at<cv::Vec2f>(row, column) = cv::Vec2f(static_cast<float>(d[0]), static_cast<float>(d[1]));
      }
  }

  double errorAt(const cv::Vec3f& start, const cv::Vec3f& displacement) const {
    const Eigen::Vector3d truth =
        scene.displacement_pmr({start[0], start[1], start[2]}, AnalyticScene::atRest(), deformation);
    return (truth - Eigen::Vector3d(displacement[0], displacement[1], displacement[2])).norm();
  }

  AnalyticScene scene = standardScene();
  AnalyticScene::Deformation deformation = sagAndShift(0.006, 0.002);
  ProjectionFrame frame;
  Projection earlier, later;
  cv::Mat flow, confidence, points;
};

TEST_F(Inversion, TrueFlowGivesTrueDisplacements) {
  const DisplacementField field = invert(frame, earlier, later, flow, confidence);
  double worst = 0;
  int valid = 0;
  for (int row = 0; row < frame.size.height; ++row)
    for (int column = 0; column < frame.size.width; ++column) {
      const cv::Vec3f start = field.start_pmr.at<cv::Vec3f>(row, column);
      if (std::isnan(start[0])) continue;
      ++valid;
      worst = std::max(worst, errorAt(start, field.displacement_pmr.at<cv::Vec3f>(row, column)));
    }
  EXPECT_GT(valid, 0.75 * cv::countNonZero(earlier.mask));
  EXPECT_LT(worst, 3e-6);  // two surfaces of linear triangles
}

TEST_F(Inversion, NearestIsWithinHalfAGridStepOfSlope) {
  InversionSettings settings;
  settings.interpolation = Interpolation::kNearest;
  const DisplacementField field = invert(frame, earlier, later, flow, confidence, settings);
  double worst = 0;
  for (int row = 0; row < frame.size.height; ++row)
    for (int column = 0; column < frame.size.width; ++column) {
      const cv::Vec3f start = field.start_pmr.at<cv::Vec3f>(row, column);
      if (!std::isnan(start[0]))
        worst = std::max(worst, errorAt(start, field.displacement_pmr.at<cv::Vec3f>(row, column)));
    }
  EXPECT_LT(worst, 7.1e-5);  // 0.071 mm to the corner of a cell, slopes below 1
  EXPECT_GT(worst, 3e-6);    // so it is not the linear one
}

TEST_F(Inversion, OwnPointsOfTheEarlierSurface) {
  const cv::Mat displacements = displacementsOfPoints(frame, earlier, later, flow, confidence);
  ASSERT_EQ(displacements.size(), points.size());
  double worst = 0;
  int valid = 0;
  for (int row = 0; row < points.rows; ++row)
    for (int column = 0; column < points.cols; ++column) {
      const cv::Vec3f d = displacements.at<cv::Vec3f>(row, column);
      if (std::isnan(d[0])) continue;
      ++valid;
      worst = std::max(worst, errorAt(points.at<cv::Vec3f>(row, column), d));
    }
  EXPECT_GT(valid, 0.75 * static_cast<double>(points.total()));
  EXPECT_LT(worst, 4e-6);
}

TEST_F(Inversion, GateAndHolesGiveNaN) {
  confidence(cv::Rect(100, 100, 20, 20)).setTo(InversionSettings().min_confidence - 0.01);
  confidence(cv::Rect(130, 100, 20, 20)).setTo(InversionSettings().min_confidence);
  const DisplacementField field = invert(frame, earlier, later, flow, confidence);
  EXPECT_TRUE(std::isnan(field.displacement_pmr.at<cv::Vec3f>(110, 110)[0]));
  EXPECT_TRUE(std::isnan(field.start_pmr.at<cv::Vec3f>(110, 110)[2]));
  EXPECT_FALSE(std::isnan(field.displacement_pmr.at<cv::Vec3f>(110, 140)[0]));
  flow.setTo(cv::Scalar(1e4, 0));
  const DisplacementField outside = invert(frame, earlier, later, flow, confidence);
  EXPECT_FALSE(cv::checkRange(outside.displacement_pmr.row(110)));
  for (auto it = outside.start_pmr.begin<cv::Vec3f>(); it != outside.start_pmr.end<cv::Vec3f>(); ++it)
    ASSERT_TRUE(std::isnan((*it)[0]));
}

TEST_F(Inversion, RefusesAnotherGrid) {
  EXPECT_THROW(invert(frame, earlier, later, flow.rowRange(0, 10), confidence), TrackingError);
}

}  // namespace
}  // namespace cortshift_tracking
