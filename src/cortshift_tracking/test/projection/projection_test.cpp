#include "cortshift_tracking/projection/projection.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "analytic_scene.hpp"
#include "cortshift_tracking/error.hpp"

namespace cortshift_tracking {
namespace {

constexpr double kDegree = M_PI / 180;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// An organised sheet z = z(x, y) seen from +z, 0.1 mm between neighbours; row 0 at the largest y, as a camera sees it.
template <typename Height>
cortshift_stereo::Surface sheet(int columns, int rows, Height height, double spacing = 0.0001) {
  cortshift_stereo::Surface surface;
  surface.points.create(rows, columns, CV_32FC3);
  surface.colour = cv::Mat(rows, columns, CV_8UC3, cv::Scalar(10, 20, 30));
  surface.confidence = cv::Mat(rows, columns, CV_32FC1, cv::Scalar(0.5));
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      const double x = column * spacing, y = -row * spacing;
      surface.points.at<cv::Vec3f>(row, column) =
          cv::Vec3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(height(x, y)));
    }
  return surface;
}

/// Grid points at the sheet's own, but for a tenth of a nanometre that keeps the rim off the rounding of floats.
ProjectionFrame flatFrame(const cortshift_stereo::Surface& surface) {
  ProjectionFrame frame;
  frame.resolution = 0.0001 * (1 - 1e-6);
  frame.size = cv::Size(surface.points.cols, surface.points.rows);
  frame.T_pmr_projection.translation() = Eigen::Vector3d(1e-10, 1e-10 - (surface.points.rows - 1) * 0.0001, 0);
  return frame;
}

TEST(ProjectionFrame, TakesAxesFromATiltedPlane) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, -2, 0.5).normalized()));
  T.translation() = Eigen::Vector3d(0.05, -0.09, 0.12);
  auto surface = sheet(201, 151, [](double, double) { return 0.0; });
  for (auto it = surface.points.begin<cv::Vec3f>(); it != surface.points.end<cv::Vec3f>(); ++it) {
    const Eigen::Vector3d p = T * Eigen::Vector3d((*it)[0], (*it)[1], (*it)[2]);
    *it = cv::Vec3f(static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2]));
  }
  const ProjectionFrame frame = fitProjectionFrame(surface);
  EXPECT_LT((frame.T_pmr_projection.linear() - T.linear()).norm(), 1e-4);
  EXPECT_NEAR(frame.T_pmr_projection.linear().determinant(), 1, 1e-9);
  EXPECT_NEAR(frame.size.width, 201, 1);
  EXPECT_NEAR(frame.size.height, 151, 1);
  const Eigen::Vector3d corner = T * Eigen::Vector3d(0, -0.015, 0);  // lower left as the camera sees it
  EXPECT_LT((frame.T_pmr_projection.translation() - corner).norm(), 1e-5);
}

TEST(ProjectionFrame, AMarginIsAddedOnEverySide) {
  const auto surface = sheet(201, 151, [](double, double) { return 0.0; });
  FrameSettings settings;
  const ProjectionFrame bare = fitProjectionFrame(surface, settings);
  settings.margin = 0.003;
  const ProjectionFrame wide = fitProjectionFrame(surface, settings);
  EXPECT_NEAR((wide.size.width - bare.size.width) * settings.resolution, 2 * 0.003, 1.5 * settings.resolution);
  EXPECT_NEAR((wide.size.height - bare.size.height) * settings.resolution, 2 * 0.003, 1.5 * settings.resolution);
  const Eigen::Vector3d corner = bare.T_pmr_projection * Eigen::Vector3d(-0.003, -0.003, 0);
  EXPECT_LT((wide.T_pmr_projection.translation() - corner).norm(), 1e-6);
}

TEST(ProjectionFrame, NormalWithstandsNoiseHolesAndOutliers) {
  const auto clean = sheet(400, 300, [](double x, double y) { return 0.2 * x - 0.1 * y; });
  auto dirty = clean;
  dirty.points = clean.points.clone();
  cv::RNG random(7);
  for (int row = 0; row < 300; ++row)
    for (int column = 0; column < 400; ++column) {
      cv::Vec3f& p = dirty.points.at<cv::Vec3f>(row, column);
      p[2] += static_cast<float>(random.gaussian(0.00005));
      if (random.uniform(0.0, 1.0) < 0.05) p = cv::Vec3f(kNaN, kNaN, kNaN);
      if (random.uniform(0.0, 1.0) < 0.01) p[2] -= 0.05F;
    }
  cv::rectangle(dirty.points, cv::Rect(0, 0, 60, 60), cv::Scalar::all(0), cv::FILLED);  // a far patch
  const double angle = std::acos(averageNormal(dirty).dot(averageNormal(clean)));
  EXPECT_LT(angle, 0.5 * kDegree);
  EXPECT_LT(fitProjectionFrame(dirty).size.area(), 1.2 * fitProjectionFrame(clean).size.area());
}

TEST(ProjectionFrame, RefusesWhatHasNoSurface) {
  auto surface = sheet(100, 100, [](double, double) { return 0.0; });
  surface.points.setTo(cv::Scalar::all(kNaN));
  EXPECT_THROW(fitProjectionFrame(surface), TrackingError);
  const auto vast = sheet(
      100, 100, [](double, double) { return 0.0; }, 0.02);
  EXPECT_THROW(fitProjectionFrame(vast), TrackingError);
  FrameSettings settings;
  settings.resolution = 0.01;
  EXPECT_THROW(fitProjectionFrame(sheet(100, 100, [](double, double) { return 0.0; }), settings), TrackingError);
}

TEST(Projection, GridPointsLieOnTheTiltedSheetExactly) {
  // A plane is linear in every triangle, so interpolation must reproduce it to float precision off the vertices too.
  const auto plane = [](double x, double y) { return 0.3 * x - 0.2 * y; };
  const auto surface = sheet(120, 90, plane, 0.000137);
  ProjectionFrame frame = flatFrame(surface);
  const Projection projection = project(surface, frame);
  int covered = 0;
  for (int row = 0; row < frame.size.height; ++row)
    for (int column = 0; column < frame.size.width; ++column) {
      if (projection.mask.at<uchar>(row, column) == 0) continue;
      ++covered;
      const double x = frame.T_pmr_projection.translation()[0] + column * frame.resolution,
                   y = frame.T_pmr_projection.translation()[1] + row * frame.resolution;
      ASSERT_NEAR(projection.height.at<float>(row, column), plane(x, y), 2e-9);
      const cv::Vec2f source = projection.source.at<cv::Vec2f>(row, column);
      ASSERT_NEAR(source[0], x / 0.000137, 2e-3);
      ASSERT_NEAR(source[1], -y / 0.000137, 2e-3);
      ASSERT_FLOAT_EQ(projection.confidence.at<float>(row, column), 0.5F);
    }
  EXPECT_EQ(covered, frame.size.area());  // no seams between triangles
  EXPECT_EQ(cv::countNonZero(projection.fold), 0);
}

TEST(Projection, CurvedSurfaceFromATiltedCameraIsExactToSecondOrder) {
  const AnalyticScene scene = standardScene();
  const PinholeCamera camera = scene.cameraAt(0.3, 12 * kDegree, 0.005, 15 * kDegree, {320, 240}, 0.032);
  const auto surface = scene.see(camera, AnalyticScene::atRest());
  const ProjectionFrame frame = fitProjectionFrame(surface);
  EXPECT_GT(frame.normal_pmr().dot(-camera.T_pmr_camera.linear().col(2)), 0.9);
  EXPECT_GT(frame.T_pmr_projection.linear().col(0).dot(camera.T_pmr_camera.linear().col(0)), 0.9);
  const Projection projection = project(surface, frame);
  EXPECT_GT(cv::countNonZero(projection.mask), 0.6 * frame.size.area());
  double worst = 0;
  for (int row = 0; row < frame.size.height; row += 3)
    for (int column = 0; column < frame.size.width; column += 3) {
      if (projection.mask.at<uchar>(row, column) == 0) continue;
      const Eigen::Vector3d p =
          frame.T_pmr_projection *
          Eigen::Vector3d(column * frame.resolution, row * frame.resolution, projection.height.at<float>(row, column));
      const Eigen::Vector2d m = scene.materialAt(p, AnalyticScene::atRest());
      worst = std::max(worst, (scene.position_pmr(m[0], m[1], AnalyticScene::atRest()) - p).norm());
    }
  EXPECT_LT(worst, 1e-6);  // curvature 300/m over 0.1 mm: h^2 / 8 * kappa = 0.4 um
}

TEST(Projection, HolesStayHoles) {
  auto surface = sheet(100, 100, [](double, double) { return 0.0; });
  surface.points(cv::Rect(40, 30, 11, 9)).setTo(cv::Scalar::all(kNaN));
  const Projection projection = project(surface, flatFrame(surface));
  // Columns 40...50, rows 30...38 of the image: rows count from below in the grid.
  const cv::Rect hole(40, 99 - 38, 11, 9);
  EXPECT_EQ(cv::countNonZero(projection.mask(hole)), 0);
  const cv::Rect rim(hole.x - 1, hole.y - 1, hole.width + 2, hole.height + 2);  // at the mercy of rounding
  EXPECT_GE(cv::countNonZero(projection.mask), 100 * 100 - rim.area());
  EXPECT_TRUE(std::isnan(projection.height.at<float>(hole.y, hole.x)));
}

TEST(Projection, DepthStepsAreCut) {
  const auto step = [](double x, double) { return x < 0.00495 ? 0.0 : 0.003; };
  const auto surface = sheet(100, 60, step);
  ProjectionFrame frame = flatFrame(surface);
  frame.resolution = 0.00005;
  frame.size = cv::Size(199, 119);
  const Projection projection = project(surface, frame);
  for (int row = 0; row < frame.size.height; ++row) {
    ASSERT_EQ(projection.mask.at<uchar>(row, 99), 0);  // between columns 49 and 50
    ASSERT_EQ(projection.mask.at<uchar>(row, 98), 255);
    ASSERT_EQ(projection.mask.at<uchar>(row, 100), 255);
  }
}

TEST(Projection, FoldsAreFlaggedAndTheNearestLayerWins) {
  // A sheet that runs right, back under itself and right again.
  cortshift_stereo::Surface surface = sheet(300, 40, [](double, double) { return 0.0; });
  for (int row = 0; row < 40; ++row)
    for (int column = 0; column < 300; ++column) {
      const double s = column * 0.0001;
      const double x = s < 0.01 ? s : s < 0.015 ? 0.02 - s : s - 0.01;
      const double z = s < 0.01 ? 0 : s < 0.015 ? -(s - 0.01) * 0.8 : -0.004;
      surface.points.at<cv::Vec3f>(row, column)[0] = static_cast<float>(x);
      surface.points.at<cv::Vec3f>(row, column)[2] = static_cast<float>(z);
    }
  const Projection projection = project(surface, flatFrame(surface));
  EXPECT_EQ(projection.fold.at<uchar>(20, 30), 0);
  EXPECT_EQ(projection.fold.at<uchar>(20, 70), 255);
  EXPECT_NEAR(projection.height.at<float>(20, 70), 0, 1e-9);
  EXPECT_EQ(projection.fold.at<uchar>(20, 150), 0);
  EXPECT_NEAR(projection.height.at<float>(20, 150), -0.004, 1e-8);
}

TEST(Projection, LayersCloserThanTheToleranceAreNoFold) {
  const auto foldedBy = [](double gap, const ProjectionSettings& settings) {
    // A sheet that runs right, back under itself and right again `gap` below: over x = 7 mm three layers.
    cortshift_stereo::Surface surface = sheet(300, 40, [](double, double) { return 0.0; });
    for (int row = 0; row < 40; ++row)
      for (int column = 0; column < 300; ++column) {
        const double s = column * 0.0001;
        const double x = s < 0.01 ? s : s < 0.015 ? 0.02 - s : s - 0.01;
        const double z = s < 0.01 ? 0 : s < 0.015 ? -(s - 0.01) / 0.005 * gap : -gap;
        surface.points.at<cv::Vec3f>(row, column)[0] = static_cast<float>(x);
        surface.points.at<cv::Vec3f>(row, column)[2] = static_cast<float>(z);
      }
    return project(surface, flatFrame(surface), settings).fold.at<uchar>(20, 70) != 0;
  };
  EXPECT_FALSE(foldedBy(0.00025, {}));
  EXPECT_TRUE(foldedBy(0.00035, {}));  // the default is 0.3 mm
  ProjectionSettings wide;
  wide.fold_tolerance = 0.002;
  EXPECT_FALSE(foldedBy(0.0019, wide));
  EXPECT_TRUE(foldedBy(0.0021, wide));
}

TEST(Projection, SameBitsForOneAndTwoThreads) {
  const AnalyticScene scene = standardScene();
  const auto surface = scene.see(scene.cameraAt(0.3, 0.1, 0, 0.2, {200, 150}, 0.03), AnalyticScene::atRest());
  const ProjectionFrame frame = fitProjectionFrame(surface);
  ProjectionSettings one, two;
  one.threads = 1;
  two.threads = 2;
  const Projection a = project(surface, frame, one), b = project(surface, frame, two);
  const auto sameBits = [](const cv::Mat& p, const cv::Mat& q) {
    return p.total() == q.total() && std::memcmp(p.data, q.data, p.total() * p.elemSize()) == 0;
  };
  EXPECT_TRUE(sameBits(a.colour, b.colour));
  EXPECT_TRUE(sameBits(a.height, b.height));
  EXPECT_TRUE(sameBits(a.source, b.source));
  EXPECT_TRUE(sameBits(a.mask, b.mask));
}

// A grid coarser than the camera's pixels takes smoothed colours, but not by smoothing those of the stage.
TEST(Projection, LeavesTheSurfaceAsItIs) {
  const auto surface = sheet(120, 90, [](double, double) { return 0.0; });
  cv::Mat colour = surface.colour;
  cv::RNG random(3);
  random.fill(colour, cv::RNG::UNIFORM, 0, 255);
  const cv::Mat before = colour.clone();
  FrameSettings coarse;
  coarse.resolution = 0.0004;
  project(surface, fitProjectionFrame(surface, coarse));
  EXPECT_EQ(cv::norm(surface.colour, before, cv::NORM_INF), 0);
}

TEST(Projection, RefusesImagesThatDoNotFit) {
  auto surface = sheet(50, 50, [](double, double) { return 0.0; });
  const ProjectionFrame frame = flatFrame(surface);
  surface.confidence = cv::Mat();
  EXPECT_THROW(project(surface, frame), TrackingError);
}

}  // namespace
}  // namespace cortshift_tracking
