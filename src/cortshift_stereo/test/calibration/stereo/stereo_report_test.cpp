// Every number of the report stands under its own key, in the unit that the key names.
#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"

#include <gmock/gmock.h>
#include <yaml-cpp/yaml.h>

#include <opencv2/calib3d.hpp>

#include "scratch_folder.hpp"

namespace cortshift_stereo {
namespace {

/// Errors that are all different: `first`, and steps from there.
SetErrors someErrors(double first) {
  PairErrors pair;
  pair.name = "07";
  pair.rms = first + 0.01;
  pair.left_rms = first + 0.02;
  pair.right_rms = first + 0.03;
  pair.epipolar_rms = first + 0.04;
  pair.spacing_error = (first + 0.05) * 1e-3;
  return {first + 0.06, first + 0.07, (first + 0.08) * 1e-3, {pair}};
}

StereoReport someReport() {
  StereoReport report;
  report.date = "2014-01-02T03:04:05Z";
  report.images = "some folder: with a colon";
  report.board.corners = {9, 6};
  report.board.square = 0.0042;
  StereoCalibration& calibration = report.calibration;
  calibration.parameters.size = {1024, 768};
  calibration.parameters.K_left = cv::Matx33d(3900, 0, 511, 0, 3800, 383, 0, 0, 1);
  calibration.parameters.K_right = cv::Matx33d(3700, 0, 513, 0, 3650, 385, 0, 0, 1);
  calibration.parameters.D_left = {-0.1, 0.2, 0, 0, 0};
  calibration.parameters.D_right = {-0.3, 0.4, 0, 0, 0};
  cv::Rodrigues(cv::Vec3d(0.01, 0.02, 0.03), calibration.parameters.R_right_left);
  calibration.parameters.t_right_left = {-0.024, 0.001, 0.002};
  calibration.model = "k1 k2";
  calibration.scores = {{"k1", someErrors(1)}, {"k1 k2", someErrors(2)}};
  calibration.used = someErrors(3);
  calibration.focal_deviation = 0.0017;
  calibration.left_alone_rms = 0.11;
  calibration.right_alone_rms = 0.12;
  calibration.reach = 0.83;
  calibration.distance = 0.31;
  report.checks = someErrors(4);
  return report;
}

void expectErrors(const YAML::Node& node, double first, bool with_views = true) {
  EXPECT_NEAR(node["reprojection_rms_px"].as<double>(), first + 0.06, 1e-9);
  EXPECT_NEAR(node["epipolar_rms_px"].as<double>(), first + 0.07, 1e-9);
  EXPECT_NEAR(node["corner_spacing_error_mm"].as<double>(), first + 0.08, 1e-9);
  if (!with_views) return;
  const YAML::Node view = node["views"][0];
  EXPECT_EQ(view["name"].as<std::string>(), "07");
  EXPECT_NEAR(view["reprojection_rms_px"].as<double>(), first + 0.01, 1e-9);
  EXPECT_NEAR(view["left_rms_px"].as<double>(), first + 0.02, 1e-9);
  EXPECT_NEAR(view["right_rms_px"].as<double>(), first + 0.03, 1e-9);
  EXPECT_NEAR(view["epipolar_rms_px"].as<double>(), first + 0.04, 1e-9);
  EXPECT_NEAR(view["corner_spacing_error_mm"].as<double>(), first + 0.05, 1e-9);
}

void expectCamera(const YAML::Node& node, double fx, double fy, double cx, double cy, std::vector<double> lens) {
  EXPECT_EQ(node["focal_length_px"].as<double>(), fy);
  EXPECT_NEAR(node["aspect_fx_over_fy"].as<double>(), fx / fy, 1e-12);
  EXPECT_EQ(node["cx_px"].as<double>(), cx);
  EXPECT_EQ(node["cy_px"].as<double>(), cy);
  EXPECT_EQ(node["distortion_k1_k2_p1_p2_k3"].as<std::vector<double>>(), lens);
}

TEST(StereoReport, EveryNumberStandsUnderItsKey) {
  const YAML::Node read = YAML::Load(reportText(someReport()));
  EXPECT_EQ(read["date"].as<std::string>(), "2014-01-02T03:04:05Z");
  EXPECT_EQ(read["images"].as<std::string>(), "some folder: with a colon");
  EXPECT_EQ(read["board"]["inner_corners"].as<std::string>(), "9x6");
  EXPECT_NEAR(read["board"]["square_mm"].as<double>(), 4.2, 1e-12);
  EXPECT_EQ(read["image_size_px"].as<std::vector<int>>(), (std::vector<int>{1024, 768}));
  expectCamera(read["left"], 3900, 3800, 511, 383, {-0.1, 0.2, 0, 0, 0});
  expectCamera(read["right"], 3700, 3650, 513, 385, {-0.3, 0.4, 0, 0, 0});
  const auto turn = read["left_in_right"]["rotation_vector_deg"].as<std::vector<double>>(),
             offset = read["left_in_right"]["translation_mm"].as<std::vector<double>>();
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(turn[i], 0.01 * static_cast<double>(i + 1) * 180 / M_PI, 1e-6);
    EXPECT_NEAR(offset[i], std::vector<double>({-24, 1, 2})[i], 1e-9);
  }
  EXPECT_NEAR(read["baseline_mm"].as<double>(), std::sqrt(24 * 24 + 1 + 4.0), 1e-4);
  EXPECT_NEAR(read["focal_length_deviation_percent"].as<double>(), 0.17, 1e-9);
  EXPECT_EQ(read["lens"].as<std::string>(), "plumb_bob");
  EXPECT_NEAR(read["reprojection_rms_alone_px"]["left"].as<double>(), 0.11, 1e-9);
  EXPECT_NEAR(read["reprojection_rms_alone_px"]["right"].as<double>(), 0.12, 1e-9);
  EXPECT_NEAR(read["reach"].as<double>(), 0.83, 1e-9);
  EXPECT_NEAR(read["board_distance_mm"].as<double>(), 310, 1e-9);
  EXPECT_EQ(read["distortion_model"].as<std::string>(), "k1 k2");
  EXPECT_EQ(read["cross_validation"][1]["model"].as<std::string>(), "k1 k2");
  expectErrors(read["cross_validation"][0], 1, false);
  expectErrors(read["cross_validation"][1], 2, false);
  EXPECT_EQ(read["held_out_in_turn"]["views"][0]["reprojection_rms_px"].as<double>(), 2.01);
  expectErrors(read["used"], 3);
  expectErrors(read["checked"], 4);
  EXPECT_EQ(read["rejected"].size(), 0U);
}

TEST(StereoReport, TheHeadOfEachFileTellsHowItWasMade) {
  EXPECT_THAT(remarksText(someReport()),
              testing::HasSubstr("from 1 views of a 9x6 board with squares of 4.2 mm.\nLens: plumb_bob, terms k1 k2. "
                                 "Reprojection RMS 3.060 px, on held-out views 2.060 px, epipolar 2.070 px."));
}

TEST(StereoReport, ItsResidualsAreReadBack) {
  const ScratchFolder folder;
  writeStereoCalibration(folder.path(), someReport());
  const StereoResiduals read = readStereoResiduals(folder.file("report.yaml"));
  EXPECT_NEAR(read.focal_deviation, 0.0017, 1e-9);
  EXPECT_NEAR(read.epipolar_rms, 2.07, 1e-9);
  EXPECT_EQ(read.focal_length, 3800);
  EXPECT_NEAR(read.baseline, std::sqrt(24 * 24 + 1 + 4.0) * 1e-3, 1e-7);
}

}  // namespace
}  // namespace cortshift_stereo
