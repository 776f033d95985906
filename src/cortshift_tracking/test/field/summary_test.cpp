#include "cortshift_tracking/field/summary.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace cortshift_tracking {
namespace {

DisplacementField fieldOf(const std::vector<cv::Vec3f>& vectors) {
  DisplacementField field;
  field.displacement_pmr = cv::Mat(vectors, true).reshape(3, 1);
  return field;
}

TEST(Summary, NumbersComputedByHand) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  // (3, 4, 0), (0, 0, -2) and (0, 0, 12) mm; normal +z; gravity -y tilted: here simply -y.
  const DisplacementField field = fieldOf({{0.003F, 0.004F, 0}, {nan, nan, nan}, {0, 0, -0.002F}, {0, 0, 0.012F}});
  const Summary summary = summarise(field, 0.75, Eigen::Vector3d::UnitZ(), -Eigen::Vector3d::UnitY());
  EXPECT_EQ(summary.valid_points, 3U);
  EXPECT_DOUBLE_EQ(summary.overlap, 0.75);
  EXPECT_NEAR(summary.magnitude.mean, 19e-3 / 3, 1e-9);
  EXPECT_NEAR(summary.magnitude.sd, std::sqrt((1.7777778 + 18.7777778 + 32.1111111) / 2) * 1e-3, 1e-9);
  EXPECT_NEAR(summary.normal.mean, 10e-3 / 3, 1e-9);
  EXPECT_NEAR(summary.lateral.mean, 5e-3 / 3, 1e-9);
  EXPECT_NEAR(summary.lateral.sd, 2.8867513e-3, 1e-9);
  EXPECT_NEAR(summary.gravity.mean, -4e-3 / 3, 1e-9);
  EXPECT_NEAR(summary.gravity_normal_angle, M_PI / 2, 1e-12);
}

TEST(Summary, UnknownStaysUnknown) {
  const Summary no_gravity = summarise(fieldOf({{0.001F, 0, 0}}), 1, Eigen::Vector3d::UnitZ(), std::nullopt);
  EXPECT_TRUE(std::isnan(no_gravity.gravity.mean));
  EXPECT_TRUE(std::isnan(no_gravity.gravity_normal_angle));
  EXPECT_EQ(no_gravity.magnitude.sd, 0);
  EXPECT_NE(toText(no_gravity).find("along gravity not known"), std::string::npos);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Summary empty = summarise(fieldOf({{nan, nan, nan}}), 1, Eigen::Vector3d::UnitZ(), std::nullopt);
  EXPECT_EQ(empty.valid_points, 0U);
  EXPECT_TRUE(std::isnan(empty.magnitude.mean));
}

}  // namespace
}  // namespace cortshift_tracking
