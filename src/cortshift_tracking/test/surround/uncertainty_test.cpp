#include "cortshift_tracking/surround/uncertainty.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace cortshift_tracking {
namespace {

constexpr double kSpacing = 0.0001;  // [m] a pixel of the cameras on the surface

ProjectionFrame frame() {
  ProjectionFrame frame;
  frame.resolution = 0.0002;
  frame.size = {20, 10};
  return frame;
}

/// A flat surface at height 0. @param confidence  of its disparities
Projection flat(float confidence) {
  Projection projection;
  projection.resolution = frame().resolution;
  projection.confidence = cv::Mat(frame().size, CV_32FC1, cv::Scalar(confidence));
  projection.height = cv::Mat::zeros(frame().size, CV_32FC1);
  projection.mask = cv::Mat(frame().size, CV_8UC1, cv::Scalar(255));
  return projection;
}

PlacedCamera cameraAt(double distance) {
  PlacedCamera camera;
  camera.T_pmr_camera.translation() = Eigen::Vector3d(0.002, 0.001, distance);
  return camera;
}

double ownOf(float first, float second, float match, double pixel) {
  const Projection earlier = flat(first), later = flat(second);
  const cv::Mat flow = cv::Mat::zeros(frame().size, CV_32FC2),
                flow_confidence(frame().size, CV_32FC1, cv::Scalar(match));
  const Measured measured{earlier, later, flow, flow_confidence, pixel, pixel};
  return ownErrorsOf(measured, heightErrorsOf(measured)).at<float>(5, 10);
}

TEST(Uncertainty, APixelOfDisparityIsLongerTheFartherTheCameraIs) {
  // With a baseline of 25 mm: 12 times the width of a pixel from 300 mm, 8 times from 200 mm.
  EXPECT_NEAR(pixelOfDisparity(flat(1), kSpacing, frame(), cameraAt(0.3), 0.025), 0.0012, 1e-9);
  EXPECT_NEAR(pixelOfDisparity(flat(1), kSpacing, frame(), cameraAt(0.2), 0.025), 0.0008, 1e-9);
  EXPECT_NEAR(pixelOfDisparity(flat(1), kSpacing, frame(), std::nullopt, 0.025), 0.0012, 1e-9);
  EXPECT_NEAR(pixelOfDisparity(flat(1), kSpacing, frame(), cameraAt(0.3), 0.005), 0.006, 1e-9) << "an endoscope's";
}

TEST(Uncertainty, AVectorsOwnErrorIsThatOfHeightsAndMatch) {
  const double pixel = 0.001;
  EXPECT_NEAR(ownOf(0.5F, 1, 1, pixel), 0.1 * pixel, 1e-9);  // half: a tenth of a pixel of disparity
  EXPECT_NEAR(ownOf(0.5F, 0.5F, 1, pixel), std::sqrt(2) * 0.1 * pixel, 1e-9);
  EXPECT_NEAR(ownOf(1, 1, 0.5F, pixel), 0.25 * 0.0002, 1e-9);  // half: a quarter of a grid step
  EXPECT_NEAR(ownOf(0.5F, 0.5F, 1, 0.4 * pixel), 0.4 * ownOf(0.5F, 0.5F, 1, pixel), 1e-9) << "close up";
  EXPECT_LE(ownOf(0, 1, 1, pixel), 0.0100001) << "a point that nothing is known of";
}

TEST(Uncertainty, WhatAllVectorsHaveInCommonIsAdded) {
  DisplacementField field;
  field.frame = frame();
  field.start_pmr = field.displacement_pmr = cv::Mat::zeros(frame().size, CV_32FC3);
  Surround surround;
  surround.covariance.topLeftCorner<3, 3>() = Eigen::Vector3d(9e-8, 0, 0).asDiagonal();  // 0.3 mm
  const cv::Mat own(frame().size, CV_32FC1, cv::Scalar(0.0004));
  EXPECT_NEAR(uncertaintyOf(field, own, surround).at<float>(5, 10), 0.0005, 1e-8);
  Summary summary;
  addBudget(summary, field, own, surround);
  EXPECT_NEAR(summary.common_sd, 0.0003, 1e-9);
  ASSERT_FALSE(summary.budget.empty());
  EXPECT_EQ(summary.budget.back().source, "match and heights");
  EXPECT_NEAR(summary.budget.back().sd, 0.0004, 1e-8);
}

}  // namespace
}  // namespace cortshift_tracking
