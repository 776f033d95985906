#include "cortshift_tracking/field/composition.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace cortshift_tracking {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr double kConfidence = 0.9;

/// A plane at `height` [m] in a turned frame, with displacements (in pmr) that are linear in the place on it.
DisplacementField plane(double turn, double height, const Eigen::Matrix3d& gradient, const Eigen::Vector3d& constant) {
  DisplacementField field;
  field.frame.T_pmr_projection =
      Eigen::Translation3d(-0.02, -0.02, height) * Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ());
  field.frame.resolution = 0.0004;
  field.frame.size = {100, 110};
  field.start_pmr = cv::Mat(field.frame.size, CV_32FC3);
  field.displacement_pmr = field.start_pmr.clone();
  field.colour = cv::Mat(field.frame.size, CV_8UC3, cv::Scalar(1, 2, 3));
  field.confidence = cv::Mat(field.frame.size, CV_32FC1, cv::Scalar(kConfidence));
  for (int row = 0; row < field.frame.size.height; ++row)
    for (int column = 0; column < field.frame.size.width; ++column) {
      const Eigen::Vector3f p =
          (field.frame.T_pmr_projection * Eigen::Vector3d(0.0004 * column, 0.0004 * row, 0)).cast<float>();
      const Eigen::Vector3f d = (gradient * p.cast<double>() + constant).cast<float>();
      field.start_pmr.at<cv::Vec3f>(row, column) = {p.x(), p.y(), p.z()};
      field.displacement_pmr.at<cv::Vec3f>(row, column) = {d.x(), d.y(), d.z()};
    }
  return field;
}

class Composition : public testing::Test {
 protected:
  Eigen::Matrix3d gradient = (Eigen::Matrix3d() << 0.05, 0.02, 0, -0.03, 0.04, 0, 0.1, 0, 0).finished();
  Eigen::Vector3d constant = Eigen::Vector3d(0.001, -0.0005, 0.002);
  // The first lifts its plane by exactly 3 mm and moves it aside, the second goes on from there on another grid.
  DisplacementField first = plane(0.1, 0.010, Eigen::Matrix3d::Zero(), {0.002, 0.001, 0.003});
  DisplacementField second = plane(0.3, 0.013, gradient, constant);
};

TEST_F(Composition, GoesOnFromWhereTheFirstLeads) {
  const DisplacementField both = composed(first, second);
  int valid = 0;
  for (int row = 0; row < both.frame.size.height; ++row)
    for (int column = 0; column < both.frame.size.width; ++column) {
      const cv::Vec3f &p = both.start_pmr.at<cv::Vec3f>(row, column),
                      &d = both.displacement_pmr.at<cv::Vec3f>(row, column);
      ASSERT_EQ(std::isnan(p[0]), std::isnan(d[0]));
      if (std::isnan(d[0])) {
        EXPECT_EQ(both.confidence.at<float>(row, column), 0);
        continue;
      }
      ++valid;
      const Eigen::Vector3d step(0.002, 0.001, 0.003);
      const Eigen::Vector3d expected = step + gradient * (Eigen::Vector3d(p[0], p[1], p[2]) + step) + constant;
      ASSERT_LT((expected - Eigen::Vector3d(d[0], d[1], d[2])).norm(), 1e-7);
      EXPECT_NEAR(both.confidence.at<float>(row, column), kConfidence * kConfidence, 1e-6);
    }
  EXPECT_GT(valid, 7000);   // what lies on both grids
  EXPECT_LT(valid, 10500);  // and the rest is not known
  EXPECT_EQ(both.frame.size, first.frame.size);
  EXPECT_EQ(both.colour.at<cv::Vec3b>(50, 50), cv::Vec3b(1, 2, 3));
}

TEST_F(Composition, KnowsNothingWhereEitherKnowsNothing) {
  first.start_pmr.at<cv::Vec3f>(50, 50) = first.displacement_pmr.at<cv::Vec3f>(50, 50) = {kNaN, kNaN, kNaN};
  EXPECT_TRUE(std::isnan(composed(first, second).displacement_pmr.at<cv::Vec3f>(50, 50)[0]));
  EXPECT_FALSE(std::isnan(composed(first, second).displacement_pmr.at<cv::Vec3f>(60, 50)[0]));
  second.start_pmr.setTo(cv::Scalar::all(kNaN));
  second.displacement_pmr.setTo(cv::Scalar::all(kNaN));
  EXPECT_TRUE(std::isnan(composed(first, second).displacement_pmr.at<cv::Vec3f>(60, 50)[0]));
}

TEST_F(Composition, RefusesAnotherSurface) {
  const auto centre = [](const DisplacementField& field) { return field.displacement_pmr.at<cv::Vec3f>(50, 50)[0]; };
  EXPECT_FALSE(std::isnan(centre(composed(first, plane(0.3, 0.0139, gradient, constant)))));
  EXPECT_TRUE(std::isnan(centre(composed(first, plane(0.3, 0.0141, gradient, constant)))));
}

}  // namespace
}  // namespace cortshift_tracking
