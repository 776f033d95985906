#include "cortshift_tracking/field/strain.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "cortshift_tracking/error.hpp"
#include "cortshift_tracking/field/closure.hpp"
#include "cortshift_tracking/field/exclusion.hpp"

namespace cortshift_tracking {
namespace {

ProjectionFrame turnedFrame(cv::Size size) {
  ProjectionFrame frame;
  frame.resolution = 0.0002;
  frame.size = size;
  frame.T_pmr_projection.translate(Eigen::Vector3d(0.03, -0.05, 0.09));
  frame.T_pmr_projection.rotate(Eigen::AngleAxisd(0.8, Eigen::Vector3d(1, 2, -0.5).normalized()));
  return frame;
}

/// A field over a surface of height(x, y), moved by end(point), both in the projection frame [m].
template <typename Height, typename End>
DisplacementField fieldOf(const ProjectionFrame& frame, Height height, End end) {
  DisplacementField field;
  field.frame = frame;
  field.start_pmr.create(frame.size, CV_32FC3);
  field.displacement_pmr.create(frame.size, CV_32FC3);
  for (int row = 0; row < frame.size.height; ++row)
    for (int column = 0; column < frame.size.width; ++column) {
      const double x = column * frame.resolution, y = row * frame.resolution;
      const Eigen::Vector3d start(x, y, height(x, y));
      const Eigen::Vector3d p = frame.T_pmr_projection * start,
                            d = frame.T_pmr_projection.linear() * (end(start) - start);
      for (int i = 0; i < 3; ++i) {
        field.start_pmr.at<cv::Vec3f>(row, column)[i] = static_cast<float>(p[i]);
        field.displacement_pmr.at<cv::Vec3f>(row, column)[i] = static_cast<float>(d[i]);
      }
    }
  return field;
}

double dome(double x, double y) { return -8 * ((x - 0.01) * (x - 0.01) + (y - 0.008) * (y - 0.008)); }

double worst(const cv::Mat& values, double expected) {
  double gap = 0;
  for (auto it = values.begin<float>(); it != values.end<float>(); ++it)
    if (!std::isnan(*it)) gap = std::max(gap, std::abs(*it - expected));
  return gap;
}

TEST(SurfaceStrain, RigidMotionOfACurvedSurfaceHasNone) {
  Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
  motion.translate(Eigen::Vector3d(0.002, 0.001, -0.006));
  motion.rotate(Eigen::AngleAxisd(0.2, Eigen::Vector3d(0.3, 1, 0.1).normalized()));
  const auto field = fieldOf(turnedFrame({100, 80}), dome, [&](const Eigen::Vector3d& p) { return motion * p; });
  const Strain strain = surfaceStrain(field);
  EXPECT_FALSE(std::isnan(strain.major.at<float>(40, 50)));
  EXPECT_LT(worst(strain.major, 0), 2e-4);
  EXPECT_LT(worst(strain.minor, 0), 2e-4);
}

TEST(SurfaceStrain, StretchAlongATurnedAxisIsFound) {
  // Stretched by 8 % along one axis of the plane, compressed by 5 % across it, on a flat surface.
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Matrix3d stretch = turn * Eigen::Vector3d(1.08, 0.95, 1).asDiagonal() * turn.transpose();
  const auto field = fieldOf(
      turnedFrame({100, 80}), [](double x, double y) { return 0.3 * x - 0.1 * y; },
      [&](const Eigen::Vector3d& p) {
        // In the surface's own plane: along two of its orthonormal tangents.
        const Eigen::Vector3d n = Eigen::Vector3d(-0.3, 0.1, 1).normalized(),
                              a = Eigen::Vector3d(1, 0, 0.3).normalized(), b = n.cross(a);
        Eigen::Matrix3d R;
        R << a, b, n;
        return Eigen::Vector3d(R * stretch * R.transpose() * p);
      });
  const Strain strain = surfaceStrain(field);
  EXPECT_LT(worst(strain.major, 0.08), 2e-4);
  EXPECT_LT(worst(strain.minor, -0.05), 2e-4);
}

TEST(SurfaceStrain, VaryingStrainIsFoundToSecondOrderAndHolesStayEmpty) {
  const double k = 4;  // x stretches by 2 k x: 0 ... 16 %
  auto field = fieldOf(
      turnedFrame({100, 80}), [](double, double) { return 0.0; },
      [&](const Eigen::Vector3d& p) { return Eigen::Vector3d(p[0] + k * p[0] * p[0], p[1], 0.001); });
  const float nan = std::numeric_limits<float>::quiet_NaN();
  field.displacement_pmr(cv::Rect(40, 30, 30, 30)).setTo(cv::Scalar::all(nan));
  const Strain strain = surfaceStrain(field);
  EXPECT_TRUE(std::isnan(strain.major.at<float>(45, 55)));
  for (int column = 12; column < 30; ++column)
    EXPECT_NEAR(strain.major.at<float>(40, column), 2 * k * column * 0.0002, 1e-3);
  EXPECT_TRUE(std::isnan(strain.major.at<float>(0, 0)) || strain.major.at<float>(0, 0) < 0.03F);
}

TEST(Closure, ChainsAgreeWithTheDirectFieldOrShowTheGap) {
  const auto flat = [](double, double) { return 0.0; };
  const auto moved = [](const Eigen::Vector3d& d) {
    return [d](const Eigen::Vector3d& p) { return Eigen::Vector3d(p + d); };
  };
  const ProjectionFrame frame = turnedFrame({100, 80});
  ProjectionFrame later = frame;  // the middle stage has a grid of its own
  later.T_pmr_projection.translate(Eigen::Vector3d(0.0013, 0.0007, -0.003));
  const Eigen::Vector3d first(0.001, 0.0005, -0.003), second(0.0004, -0.0003, -0.001);
  const auto one = fieldOf(frame, flat, moved(first)), two = fieldOf(later, flat, moved(second));
  const Closure good = closureOf({one, two}, fieldOf(frame, flat, moved(first + second)));
  EXPECT_GT(good.points, 5000U);
  EXPECT_LT(good.p95, 1e-7);
  const Eigen::Vector3d gap(0.0003, 0, 0.0004);
  const Closure bad = closureOf({one, two}, fieldOf(frame, flat, moved(first + second + gap)));
  EXPECT_NEAR(bad.median, 0.0005, 1e-7);
}

TEST(Closure, GivesTheMedianAndThe95thPercentileOfTheGaps) {
  const auto flat = [](double, double) { return 0.0; };
  const auto still = [](const Eigen::Vector3d& p) { return p; };
  const double k = 0.05;  // the gap grows along x, so that each column of the grid is a percentile
  const auto growing = [k](const Eigen::Vector3d& p) { return Eigen::Vector3d(p[0], p[1], p[2] + k * p[0]); };
  const ProjectionFrame frame = turnedFrame({201, 20});
  ProjectionFrame shifted = frame;  // so that no point lies on the rounding of a grid line
  shifted.T_pmr_projection.translate(Eigen::Vector3d(-0.00005, -0.00005, 0));
  const Closure closure = closureOf({fieldOf(shifted, flat, still)}, fieldOf(frame, flat, growing));
  EXPECT_EQ(closure.points, 200U * 19U);  // beyond the last row and column of `shifted` nothing is known
  EXPECT_NEAR(closure.median, k * 100 * 0.0002, k * 0.00015);
  EXPECT_NEAR(closure.p95, k * 190 * 0.0002, k * 0.00015);
}

TEST(ExcludedMask, CoversWhatThePolygonCovers) {
  const ProjectionFrame frame = turnedFrame({100, 80});
  const cv::Mat mask = excludedMask(frame, {{{0.002, 0.002}, {0.008, 0.002}, {0.008, 0.006}, {0.002, 0.006}}});
  EXPECT_EQ(mask.at<uchar>(20, 20), 255);
  EXPECT_EQ(mask.at<uchar>(20, 45), 0);
  EXPECT_EQ(mask.at<uchar>(35, 20), 0);
  EXPECT_NEAR(cv::countNonZero(mask), 30 * 20, 60);
  EXPECT_THROW(excludedMask(frame, {{{0, 0}, {1, 1}}}), TrackingError);
  EXPECT_THROW(excludedMask(frame, {{{0, 0}, {1, 1}, {std::nan(""), 0}}}), TrackingError);
}

}  // namespace
}  // namespace cortshift_tracking
