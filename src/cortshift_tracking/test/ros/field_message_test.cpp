#include "cortshift_tracking/ros/field_message.hpp"

#include <gmock/gmock.h>

#include <opencv2/imgproc.hpp>

#include "cortshift_tracking/field/exclusion.hpp"

namespace cortshift_tracking {
namespace {

DisplacementField fieldOf(const cv::Mat& brain) {
  DisplacementField field;
  field.frame.resolution = 0.0002;
  field.frame.size = brain.size();
  field.start_pmr = cv::Mat(brain.size(), CV_32FC3, cv::Scalar::all(0));
  field.displacement_pmr = cv::Mat(brain.size(), CV_32FC3, cv::Scalar::all(0.001));
  field.colour = cv::Mat::zeros(brain.size(), CV_8UC3);
  field.confidence = cv::Mat(brain.size(), CV_32FC1, cv::Scalar(1));
  field.uncertainty = cv::Mat(brain.size(), CV_32FC1, cv::Scalar(0.0001));
  field.brain = brain;
  return field;
}

TEST(FieldMessage, TheBrainKeepsWhatLiesOnItAsAHole) {
  cv::Mat brain = cv::Mat::zeros(200, 300, CV_8UC1);
  cv::ellipse(brain, {150, 100}, {120, 80}, 0, 0, 360, 255, cv::FILLED);
  const double whole = cv::countNonZero(brain);
  cv::ellipse(brain, {130, 90}, {40, 30}, 0, 0, 360, 0, cv::FILLED);  // cotton, 8 x 6 mm
  cv::circle(brain, {130, 90}, 8, 255, cv::FILLED);                   // a window in it
  cv::circle(brain, {220, 100}, 5, 0, 2);                             // the rim of a glint
  const auto message = toMessage(fieldOf(brain), {}, {}, {});
  ASSERT_EQ(message.brain.size(), 3u);  // the glint is none
  const cv::Mat read = fieldFromMessage(message).brain;
  ASSERT_EQ(read.size(), brain.size());
  EXPECT_LT(cv::countNonZero(read != brain), 0.02 * whole);
  EXPECT_EQ(read.at<uchar>(90, 110), 0);
  EXPECT_EQ(read.at<uchar>(90, 130), 255);
  EXPECT_EQ(read.at<uchar>(100, 220), 255);
}

TEST(FieldMessage, WhatLiesInTwoOutlinesIsAHole) {
  ProjectionFrame frame;
  frame.resolution = 0.001;
  frame.size = {20, 20};
  const Region outer{{0.002, 0.002}, {0.018, 0.002}, {0.018, 0.018}, {0.002, 0.018}},
      inner{{0.006, 0.006}, {0.014, 0.006}, {0.014, 0.014}, {0.006, 0.014}};
  EXPECT_EQ(outlinedMask(frame, {outer, inner}).at<uchar>(10, 10), 0);
  EXPECT_EQ(excludedMask(frame, {outer, inner}).at<uchar>(10, 10), 255);
  EXPECT_EQ(outlinedMask(frame, {outer, inner}).at<uchar>(4, 10), 255);
  EXPECT_EQ(cv::countNonZero(outlinedMask(frame, {})), 0);
}

}  // namespace
}  // namespace cortshift_tracking
