#include <gmock/gmock.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "cortshift_stereo/calibration/settings/settings_calibration.hpp"
#include "cortshift_stereo/calibration/settings/settings_verdict.hpp"
#include "scratch_folder.hpp"
#include "simulated_zoom_head.hpp"

namespace cortshift_stereo {
namespace {

const std::vector<double> kMagnifications{0.7, 0.85, 1.0, 1.2, 1.4};
const std::vector<double> kFocalLengths{0.25, 0.28, 0.3, 0.32, 0.35};
constexpr double kCornerNoise = 0.05;  // [px] a side, as findBoard has on sharp images

/// Views of a small board at all settings and of a large one where all of it is in the image.
std::vector<SettingView> viewsOf(const SimulatedZoomHead& head, Side side, double noise, std::mt19937& random) {
  std::normal_distribution<double> normal;
  const auto noisy = [&](Corners corners) {
    for (auto& corner : corners) corner += noise * cv::Point2d(normal(random), normal(random));
    return corners;
  };
  std::vector<SettingView> views;
  for (const Board& board : {Board{{11, 8}, 0.004}, Board{{15, 11}, 0.005}}) {
    const auto points = boardInLeft(board);
    const Corners at_reference = noisy(head.project(side, head.reference, points));
    for (const double magnification : kMagnifications)
      for (const double focal_length : kFocalLengths) {
        const MicroscopeSetting setting{magnification, focal_length};
        const Corners exact = head.project(side, setting, points);
        const bool seen = std::all_of(exact.begin(), exact.end(), [&](const cv::Point2d& corner) {
          return corner.inside(cv::Rect2d(10, 10, head.size.width - 20, head.size.height - 20));
        });
        if (seen) views.push_back({board.name() + " at " + describe(setting), setting, noisy(exact), at_reference});
      }
  }
  return views;
}

/// A curved patch of cortex with its vessels' relief, in the left camera.
std::vector<cv::Point3d> cortex(double distance) {
  std::vector<cv::Point3d> points;
  for (double y = -0.013; y <= 0.0131; y += 0.002)
    for (double x = -0.018; x <= 0.0181; x += 0.002)
      points.emplace_back(x, y, distance + (x * x + y * y) / (2 * 0.06) - 0.003 + 0.0005 * std::sin(900 * x));
  return points;
}

std::vector<cv::Vec3d> reconstruct(const StereoModel& model, const std::vector<cv::Point2d>& left,
                                   const std::vector<cv::Point2d>& right) {
  std::vector<cv::Point2d> left_rectified, right_rectified;
  cv::undistortPoints(left, left_rectified, model.left.K, model.left.D, model.left.R, model.left.P,
                      {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-12});
  cv::undistortPoints(right, right_rectified, model.right.K, model.right.D, model.right.R, model.right.P,
                      {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-12});
  std::vector<cv::Vec3d> points;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const double depth = depthOfDisparity(model, left_rectified[i].x - right_rectified[i].x);
    const auto& P = model.left.P;
    points.push_back(model.left.R.t() * cv::Vec3d((left_rectified[i].x - P(0, 2)) / P(0, 0) * depth,
                                                  (left_rectified[i].y - P(1, 2)) / P(1, 1) * depth, depth));
  }
  return points;
}

struct SurfaceErrors {
  double along = 0, across = 0;              ///< mean over points and settings [m]
  double worst_along = 0, worst_across = 0;  ///< largest mean of a setting [m]
};

/// Errors of surfaces seen at 47 random settings and reconstructed with the reference calibration.
SurfaceErrors errorsAtRandomSettings(const SimulatedZoomHead& head, const SettingsWarp& left, const SettingsWarp& right,
                                     double distance) {
  constexpr int kSettings = 47;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> magnification(kMagnifications.front(), kMagnifications.back());
  std::uniform_real_distribution<double> focal_length(kFocalLengths.front(), kFocalLengths.back());
  const StereoModel model = head.referenceModel();
  const auto truth = cortex(distance);
  SurfaceErrors errors;
  for (int i = 0; i < kSettings; ++i) {
    const MicroscopeSetting setting{magnification(random), focal_length(random)};
    auto left_pixels = head.project(Side::kLeft, setting, truth);
    auto right_pixels = head.project(Side::kRight, setting, truth);
    for (auto& pixel : left_pixels) pixel = left.toReference(pixel, setting);
    for (auto& pixel : right_pixels) pixel = right.toReference(pixel, setting);
    const auto points = reconstruct(model, left_pixels, right_pixels);
    double along = 0, across = 0;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const cv::Vec3d error = points[k] - cv::Vec3d(truth[k]);
      along += std::abs(error[2]) / static_cast<double>(points.size());
      across += std::hypot(error[0], error[1]) / static_cast<double>(points.size());
    }
    errors.along += along / kSettings;
    errors.across += across / kSettings;
    errors.worst_along = std::max(errors.worst_along, along);
    errors.worst_across = std::max(errors.worst_across, across);
  }
  return errors;
}

struct BothSides {
  SettingsCalibration left, right;
};

BothSides calibrateBothSides(const SimulatedZoomHead& head, double noise, unsigned seed) {
  std::mt19937 random(seed);
  auto left = calibrateSettings(head.size, head.reference, viewsOf(head, Side::kLeft, noise, random));
  auto right = calibrateSettings(head.size, head.reference, viewsOf(head, Side::kRight, noise, random));
  return {std::move(left), std::move(right)};
}

void print(const char* what, const SurfaceErrors& errors) {
  std::printf("%s: along the axis %.3f mm (worst setting %.3f), across %.4f mm (%.4f)\n", what, errors.along * 1e3,
              errors.worst_along * 1e3, errors.across * 1e3, errors.worst_across * 1e3);
}

TEST(SettingsVerdict, SaysWhatIsMissing) {
  const SimulatedZoomHead head;
  std::mt19937 random(3);
  const auto views = viewsOf(head, Side::kLeft, kCornerNoise, random);
  const auto good = calibrateSettings(head.size, head.reference, views);
  EXPECT_EQ(judgeSettings(good, good).line(), "verdict: good");
  EXPECT_THAT(judgeSettings(good, good, views.size()).line(),
              testing::AllOf(testing::StartsWith("verdict: doubtful: "), testing::HasSubstr("show no board")));
  std::vector<SettingView> small, moved = views;
  const std::size_t small_board = 11 * 8;
  for (const auto& view : views)
    if (view.at_setting.size() == small_board) small.push_back(view);
  EXPECT_THAT(judgeSettings(calibrateSettings(head.size, head.reference, small), good).line(),
              testing::HasSubstr("left: boards cover"));
  for (std::size_t i = 0; i < moved.size(); ++i)  // the board crept on from setting to setting
    for (auto& corner : moved[i].at_setting) corner += 4 * cv::Point2d(i % 3 - 1.0, i % 2);
  try {
    EXPECT_THAT(judgeSettings(calibrateSettings(head.size, head.reference, moved), good).line(),
                testing::StartsWith("verdict: useless: "));
  } catch (const CalibrationError& fault) {
    EXPECT_THAT(fault.what(), testing::HasSubstr("check that the board never moved"));
  }
}

TEST(SettingsWarp, SurfacesAt47RandomSettingsAreAsAtTheReference) {
  const SimulatedZoomHead head;
  const auto both = calibrateBothSides(head, kCornerNoise, 1);
  std::printf("degrees %d; %d, %d; fit %.3f px, held out %.3f px, right %d; %d, %d, %.3f, %.3f px\n",
              both.left.image_degree, both.left.setting_degrees.first, both.left.setting_degrees.second, both.left.rms,
              both.left.held_out_rms, both.right.image_degree, both.right.setting_degrees.first,
              both.right.setting_degrees.second, both.right.rms, both.right.held_out_rms);
  const auto errors =
      errorsAtRandomSettings(head, both.left.warp, both.right.warp, SimulatedZoomHead::kWorkingDistance);
  print("fixed pupil", errors);
  EXPECT_LE(errors.along, 0.15e-3);
  EXPECT_LE(errors.across, 0.05e-3);
  EXPECT_TRUE(both.left.rejected.empty());
  // Without parallax the field is right in front of the board and behind it too.
  const auto off_plane = errorsAtRandomSettings(head, both.left.warp, both.right.warp, 0.32);
  print("fixed pupil, 20 mm below the board", off_plane);
  EXPECT_LE(off_plane.along, 0.2e-3);
}

// A field found on one plane is off by parallax elsewhere. To first order the error along the axis is the pupils'
// travel times the distance from the board over the working distance; pupils that travel along their own, verging axes
// lengthen the baseline in proportion, and the first order cancels.
TEST(SettingsWarp, WhatMovingPupilsLeaveIsReported) {
  constexpr double kTravel = 0.02, kBelow = 0.02;
  for (const bool together : {false, true}) {
    SimulatedZoomHead head;
    head.pupil_travel = kTravel;
    head.travel_together = together;
    const auto both = calibrateBothSides(head, kCornerNoise, 2);
    const auto at_board =
        errorsAtRandomSettings(head, both.left.warp, both.right.warp, SimulatedZoomHead::kWorkingDistance);
    const auto below =
        errorsAtRandomSettings(head, both.left.warp, both.right.warp, SimulatedZoomHead::kWorkingDistance + kBelow);
    std::printf("pupils travel 20 mm, %s\n", together ? "baseline unchanged" : "each along its own axis");
    print("  surface in the board's plane", at_board);
    print("  surface 20 mm below it", below);
    EXPECT_LE(at_board.along, 0.15e-3);
    EXPECT_LE(at_board.across, 0.05e-3);
    EXPECT_LE(below.along, (together ? 1 : 0.1) * kTravel * kBelow / SimulatedZoomHead::kWorkingDistance);
    EXPECT_GT(below.across, 3 * at_board.across);
  }
}

template <typename Action>
std::string refusal(const Action& action) {
  try {
    action();
  } catch (const CalibrationError& fault) {
    return fault.what();
  }
  return "not refused";
}

/// The left camera's field without noise, from few views.
const SettingsCalibration& leftField() {
  static const SettingsCalibration field = [] {
    std::mt19937 random(3);
    const SimulatedZoomHead head;
    return calibrateSettings(head.size, head.reference, viewsOf(head, Side::kLeft, 0, random));
  }();
  return field;
}

TEST(SettingsWarp, IsIdentityAtTheReferenceAndInvertible) {
  const auto& warp = leftField().warp;
  const MicroscopeSetting other{1.13, 0.31};
  for (const cv::Point2d pixel : {cv::Point2d(512, 384), cv::Point2d(300, 250), cv::Point2d(700, 500)}) {
    EXPECT_EQ(warp.toSetting(pixel, warp.model().reference), pixel);
    EXPECT_LT(cv::norm(warp.toReference(warp.toSetting(pixel, other), other) - pixel), 1e-6);
    EXPECT_GT(cv::norm(warp.toSetting(pixel, other) - pixel), 1);
  }
}

TEST(SettingsWarp, RefusesSettingsOutsideTheHullAndNamesTheRange) {
  const auto& warp = leftField().warp;
  EXPECT_TRUE(warp.covers({1.4, 0.35}));
  for (const MicroscopeSetting outside : {MicroscopeSetting{1.41, 0.3}, {1.0, 0.24}, {std::nan(""), 0.3}, {1.0, 300}}) {
    EXPECT_FALSE(warp.covers(outside));
    EXPECT_THROW(warp.toSetting({512, 384}, outside), SettingNotCalibrated);
    EXPECT_THROW(warp.compose(cv::Mat(4, 4, CV_32FC2, cv::Scalar(0, 0)), outside), SettingNotCalibrated);
  }
  EXPECT_THAT(refusal([&] {
                warp.requireCovered({1.41, 0.3});
              }),
              testing::AllOf(testing::HasSubstr("magnification 1.41, focal length 300 mm"),
                             testing::HasSubstr("magnification 0.7 to 1.4, focal length 250 to 350 mm")));
}

TEST(SettingsWarp, RefusesTheEmptyCornerOfATriangleOfSettings) {
  auto model = leftField().warp.model();
  model.calibrated = {{0.7, 0.25}, {1.4, 0.25}, {0.7, 0.35}, {1.0, 0.3}};
  const SettingsWarp warp(model);
  EXPECT_TRUE(warp.covers({0.8, 0.27}));
  EXPECT_FALSE(warp.covers({1.3, 0.34}));
  model.calibrated = {{0.7, 0.3}, {1.4, 0.3}};
  const SettingsWarp line(model);
  EXPECT_TRUE(line.covers({0.9, 0.3}));
  EXPECT_FALSE(line.covers({0.9, 0.301}));
}

TEST(SettingsWarp, ComposesWithRectificationIntoOneMap) {
  const SimulatedZoomHead head;
  const auto& warp = leftField().warp;
  const MicroscopeSetting setting{1.25, 0.29};
  const StereoModel model = head.referenceModel();
  cv::Mat to_reference, unused;
  cv::initUndistortRectifyMap(model.left.K, model.left.D, model.left.R, model.left.P, model.left.size, CV_32FC2,
                              to_reference, unused);
  const cv::Mat map = warp.compose(to_reference, setting);
  int inside = 0;
  for (int y = 0; y < map.rows; y += 16)
    for (int x = 0; x < map.cols; x += 16) {
      const auto at = map.at<cv::Point2f>(y, x);
      if (at == cv::Point2f(-1, -1)) continue;
      ++inside;
      // The ray of the rectified pixel, seen at the setting.
      const cv::Vec3d ray = model.left.R.t() * cv::Vec3d((x - model.left.P(0, 2)) / model.left.P(0, 0),
                                                         (y - model.left.P(1, 2)) / model.left.P(1, 1), 1);
      const auto expected = head.project(Side::kLeft, setting, {cv::Point3d(0.3 * ray)}).front();
      EXPECT_LT(cv::norm(cv::Point2d(at) - expected), 0.1) << x << ", " << y;
    }
  EXPECT_GT(inside, 500);
  EXPECT_EQ(map.at<cv::Point2f>(0, 0), cv::Point2f(-1, -1));  // no board was there
  EXPECT_THROW(warp.compose(cv::Mat(4, 4, CV_32FC1), setting), std::invalid_argument);
}

TEST(SettingsWarp, IsReadBackExactlyOrRefusedByFileAndKey) {
  const ScratchFolder folder;
  const std::string path = folder.file("settings_left.yaml");
  const auto& warp = leftField().warp;
  writeSettingsWarp(path, warp, "a remark");
  const SettingsWarp read = readSettingsWarp(path);
  const MicroscopeSetting setting{0.93, 0.33};
  EXPECT_EQ(read.toSetting({123, 456}, setting), warp.toSetting({123, 456}, setting));
  EXPECT_EQ(read.model().region, warp.model().region);
  EXPECT_TRUE(read.covers({0.7, 0.25}));

  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  const auto refused = [&](const std::string& from, const std::string& to) {
    std::string spoiled = text.str();
    spoiled.replace(spoiled.find(from), from.size(), to);
    std::ofstream(path) << spoiled;
    const std::string message = refusal([&] { readSettingsWarp(path); });
    EXPECT_THAT(message, testing::HasSubstr(path));
    return message;
  };
  EXPECT_THAT(refused("radius:", "radios:"), testing::HasSubstr("radius is missing"));
  EXPECT_THAT(refused("coefficients: [", "coefficients: [1, 1, "), testing::HasSubstr("coefficients for"));
  EXPECT_THAT(refused("setting_powers: [", "setting_powers: [0, 0, "), testing::HasSubstr("does not vanish"));
  EXPECT_THAT(refused("image_size: [1024", "image_size: [0"), testing::HasSubstr("image size"));
  EXPECT_THAT(refusal([] { readSettingsWarp("/nowhere/settings_left.yaml"); }), testing::HasSubstr("no such file"));
}

TEST(SettingsCalibration, NamesTheViewDuringWhichTheBoardMoved) {
  std::mt19937 random(4);
  const SimulatedZoomHead head;
  auto views = viewsOf(head, Side::kLeft, kCornerNoise, random);
  for (auto& corner : views[12].at_setting) corner += cv::Point2d(4, -3);
  const auto result = calibrateSettings(head.size, head.reference, views);
  ASSERT_EQ(result.rejected.size(), 1U);
  EXPECT_EQ(result.rejected[0].name, views[12].name);
  EXPECT_THAT(result.rejected[0].reason, testing::HasSubstr("did the board move"));
  EXPECT_LT(result.held_out_rms, 0.15);
}

TEST(SettingsCalibration, RefusesWhatCannotBeChecked) {
  std::mt19937 random(5);
  const SimulatedZoomHead head;
  const auto views = viewsOf(head, Side::kLeft, kCornerNoise, random);
  const auto calibrate = [&](std::vector<SettingView> some) {
    return refusal([&] { calibrateSettings(head.size, head.reference, some); });
  };
  EXPECT_THAT(calibrate({}), testing::HasSubstr("no views"));
  EXPECT_THAT(calibrate({views[0], views[4]}), testing::HasSubstr("no setting lies between others"));
  auto cut = views;
  cut[7].at_setting.pop_back();
  EXPECT_THAT(calibrate(cut), testing::AllOf(testing::HasSubstr(cut[7].name), testing::HasSubstr("87 corners")));
  auto zero = views;
  zero[3].setting.magnification = 0;
  EXPECT_THAT(calibrate(zero), testing::HasSubstr(zero[3].name));
  auto shuffled = views;  // settings that are not those of the images
  for (std::size_t i = 0; i < shuffled.size(); ++i) shuffled[i].setting = views[(7 * i + 3) % 25].setting;
  EXPECT_THAT(calibrate(shuffled), testing::Not("not refused"));
}

}  // namespace
}  // namespace cortshift_stereo
