#include "cortshift_stereo/geometry/lens.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace cortshift_stereo {
namespace {

CameraModel someCamera(LensModel lens, const std::vector<double>& D) {
  CameraModel camera;
  camera.size = {720, 576};
  camera.K = {900, 0, 350, 0, 905, 290, 0, 0, 1};
  camera.lens = lens;
  camera.D = D;
  const double c = std::cos(0.05), s = std::sin(0.05);
  camera.R = {c, 0, -s, 0, 1, 0, s, 0, c};
  camera.P = {850, 0, 340, 0, 0, 850, 280, 0, 0, 0, 1, 0};
  return camera;
}

std::vector<CameraModel> someCameras() {
  return {someCamera(LensModel::kPlumbBob, {-0.35, 0.1, 0.001, -0.002, 0.05}),
          someCamera(LensModel::kRationalPolynomial, {0.3, -0.2, 0.001, -0.002, 0.1, 0.5, -0.1, 0.02}),
          someCamera(LensModel::kEquidistant, {-0.1, 0.05, -0.02, 0.01})};
}

std::vector<cv::Point2d> grid(const cv::Size& size) {
  std::vector<cv::Point2d> pixels;
  for (int y = 0; y < size.height; y += 48)
    for (int x = 0; x < size.width; x += 48) pixels.emplace_back(x, y);
  return pixels;
}

std::string refusal(LensModel lens, const std::vector<double>& D) {
  try {
    checkedCoefficients(lens, D, "left.yaml: D");
  } catch (const CalibrationError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Lens, ProjectingWhatAPixelLooksAlongGivesThePixel) {
  for (const CameraModel& camera : someCameras()) {
    const std::vector<cv::Point2d> pixels = grid(camera.size), directions = directionsOf(camera, pixels);
    std::vector<cv::Point3d> points;
    for (const cv::Point2d& direction : directions) points.emplace_back(0.3 * direction.x, 0.3 * direction.y, 0.3);
    const std::vector<cv::Point2d> back = projectPoints(camera, points, {0, 0, 0}, {0, 0, 0});
    for (std::size_t i = 0; i < pixels.size(); ++i)
      EXPECT_LT(cv::norm(back[i] - pixels[i]), 1e-5) << nameOf(camera.lens) << " at " << pixels[i];
  }
}

TEST(Lens, MapAndPointsOfTheRectifiedImageAgree) {
  for (const CameraModel& camera : someCameras()) {
    const cv::Mat map = rectifyingMap(camera);
    const std::vector<cv::Point2d> rectified = grid(camera.size);
    std::vector<cv::Point2d> raw;
    for (const cv::Point2d& at : rectified) raw.emplace_back(map.at<cv::Point2f>(at));
    const std::vector<cv::Point2d> back = rectifyPoints(camera, raw);
    for (std::size_t i = 0; i < rectified.size(); ++i)
      EXPECT_LT(cv::norm(back[i] - rectified[i]), 1e-3) << nameOf(camera.lens) << " at " << rectified[i];
  }
}

TEST(Lens, ZerosAreAPinholeButNotForAFisheye) {
  const std::vector<cv::Point2d> corner{{0, 0}};
  const cv::Point2d straight(-350.0 / 900, -290.0 / 905);
  EXPECT_LT(cv::norm(directionsOf(someCamera(LensModel::kPlumbBob, {}), corner)[0] - straight), 1e-12);
  EXPECT_LT(
      cv::norm(directionsOf(someCamera(LensModel::kRationalPolynomial, std::vector<double>(8)), corner)[0] - straight),
      1e-12);
  const double angle = cv::norm(straight);
  const cv::Point2d bent = directionsOf(someCamera(LensModel::kEquidistant, std::vector<double>(4)), corner)[0];
  EXPECT_NEAR(cv::norm(bent), std::tan(angle), 1e-7);
}

TEST(Lens, NamesAreThoseOfCameraInfo) {
  for (const LensModel lens : {LensModel::kPlumbBob, LensModel::kRationalPolynomial, LensModel::kEquidistant})
    EXPECT_EQ(lensNamed(nameOf(lens), ""), lens);
  try {
    lensNamed("kannala_brandt", "left.yaml: distortion_model");
    FAIL();
  } catch (const CalibrationError& error) {
    EXPECT_STREQ(error.what(),
                 "left.yaml: distortion_model is 'kannala_brandt'; plumb_bob, rational_polynomial and equidistant are "
                 "supported: calibrate with one of them");
  }
}

TEST(Lens, CountsOfCoefficientsAreChecked) {
  EXPECT_EQ(checkedCoefficients(LensModel::kPlumbBob, {1, 2, 3, 4}, ""), std::vector<double>({1, 2, 3, 4, 0}));
  EXPECT_EQ(checkedCoefficients(LensModel::kPlumbBob, {1, 2, 3, 4, 5, 0, 0, 0}, ""),
            std::vector<double>({1, 2, 3, 4, 5}));
  std::vector<double> fourteen(14, 0.0);
  fourteen[7] = 0.5;
  EXPECT_EQ(checkedCoefficients(LensModel::kRationalPolynomial, fourteen, "").size(), 8U);
  EXPECT_EQ(refusal(LensModel::kPlumbBob, fourteen).find("left.yaml: D has 14 values"), 0U);
  fourteen[13] = 1e-3;
  EXPECT_NE(refusal(LensModel::kRationalPolynomial, fourteen).find("tilted sensor"), std::string::npos);
  EXPECT_NE(refusal(LensModel::kRationalPolynomial, std::vector<double>(12, 0.1)).find("thin prism"),
            std::string::npos);
  EXPECT_NE(refusal(LensModel::kRationalPolynomial, {1, 2, 3, 4, 5}).find("has 5 values; rational_polynomial has 8"),
            std::string::npos);
  EXPECT_NE(refusal(LensModel::kEquidistant, {1, 2, 3, 4, 0}).find("has 5 values; equidistant has 4"),
            std::string::npos);
  EXPECT_NE(refusal(LensModel::kPlumbBob, {1, 2, 3}).find("plumb_bob has 5"), std::string::npos);
}

}  // namespace
}  // namespace cortshift_stereo
