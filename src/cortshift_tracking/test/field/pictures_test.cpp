// Pictures of a result: the outline of the brain is drawn where it is, and nothing else is changed.
#include "cortshift_tracking/field/pictures.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <opencv2/imgproc.hpp>

namespace cortshift_tracking {
namespace {

const cv::Size kGrid(160, 120);
const cv::Rect kBrain(40, 30, 70, 50);  // columns and rows of the grid; row 0 is the lowest of a picture

ShiftResult stillResult(bool brain_known) {
  ShiftResult result;
  result.field.frame.size = kGrid;
  result.field.frame.resolution = 0.0004;
  result.field.displacement_pmr = cv::Mat(kGrid, CV_32FC3, cv::Scalar::all(0.001));
  result.earlier.colour = cv::Mat(kGrid, CV_32FC3);
  cv::RNG random(1);
  random.fill(result.earlier.colour, cv::RNG::UNIFORM, 0.2, 0.7);
  result.earlier.mask = cv::Mat(kGrid, CV_8UC1, cv::Scalar(255));
  result.later = result.earlier;
  if (brain_known) {
    result.field.brain = cv::Mat::zeros(kGrid, CV_8UC1);
    result.field.brain(kBrain) = 255;
  }
  return result;
}

class BrainInPictures : public testing::TestWithParam<cv::Mat (*)(const ShiftResult&)> {};

TEST_P(BrainInPictures, AreItsBorderAndALegendAndNothingElse) {
  const cv::Mat with = GetParam()(stillResult(true)), without = GetParam()(stillResult(false));
  ASSERT_EQ(with.size(), without.size());
  const double scale = static_cast<double>(with.cols) / kGrid.width;
  const int map_rows = static_cast<int>(kGrid.height * scale);
  cv::Mat border = cv::Mat::zeros(kGrid, CV_8UC1), upright, near;
  border(kBrain) = 255;
  cv::flip(border, upright, 0);
  cv::resize(upright, upright, {}, scale, scale, cv::INTER_NEAREST);
  cv::morphologyEx(upright, near, cv::MORPH_GRADIENT, cv::Mat::ones(17, 17, CV_8UC1));  // 8 px to either side

  cv::Mat difference;
  cv::absdiff(with, without, difference);
  cv::Mat changed;
  cv::cvtColor(difference, changed, cv::COLOR_BGR2GRAY);
  changed = changed > 0;
  const cv::Mat in_map = changed.rowRange(0, map_rows), in_legend = changed.rowRange(map_rows, changed.rows);
  EXPECT_EQ(cv::countNonZero(in_map & ~near), 0);
  const double around = 2 * (kBrain.width + kBrain.height) * scale;
  EXPECT_GT(cv::countNonZero(in_map), around);
  EXPECT_LT(cv::countNonZero(in_map), 5 * around);
  EXPECT_GT(cv::countNonZero(in_legend), 50);
}

INSTANTIATE_TEST_SUITE_P(Pictures, BrainInPictures,
                         testing::Values(
                             &overlayBefore, [](const ShiftResult& result) { return magnitudeMap(result.field); },
                             [](const ShiftResult& result) {
                               return normalMap(result.field, Eigen::Vector3d::UnitZ());
                             }));

}  // namespace
}  // namespace cortshift_tracking
