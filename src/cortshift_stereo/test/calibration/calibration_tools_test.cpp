// The tools as people run them: rendered and real images in, files out, exit codes.
#include <gmock/gmock.h>
#include <sys/wait.h>
#include <yaml-cpp/yaml.h>

#include <Eigen/Geometry>
#include <array>
#include <cstdio>
#include <fstream>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/calibration/hand_eye/hand_eye_yaml.hpp"
#include "cortshift_stereo/calibration/settings/settings_report.hpp"
#include "cortshift_stereo/calibration/settings/settings_warp.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"
#include "cortshift_stereo_phantom/board_image.hpp"
#include "real_chessboards.hpp"
#include "scratch_folder.hpp"
#include "simulated_hand_eye.hpp"
#include "simulated_zoom_head.hpp"

namespace cortshift_stereo {
namespace {

struct Outcome {
  int code;
  std::string text;  ///< stdout and stderr
};

Outcome run(const std::string& command) {
  FILE* pipe = popen((TOOL_FOLDER "/" + command + " 2>&1").c_str(), "r");
  if (!pipe) return {-1, "cannot start"};
  Outcome outcome{-1, ""};
  std::array<char, 4096> buffer;
  while (const std::size_t count = std::fread(buffer.data(), 1, buffer.size(), pipe))
    outcome.text.append(buffer.data(), count);
  const int status = pclose(pipe);
  if (WIFEXITED(status)) outcome.code = WEXITSTATUS(status);
  return outcome;
}

testing::Matcher<Outcome> endsWith(int code, const std::string& text) {
  return testing::AllOf(testing::Field(&Outcome::code, code), testing::Field(&Outcome::text, testing::HasSubstr(text)));
}

void PrintTo(const Outcome& outcome, std::ostream* stream) {
  *stream << "exit " << outcome.code << ": " << outcome.text;
}

TEST(Tools, AnswerHelpAndRefuseBadUsage) {
  for (const std::string tool : {"calibrate_stereo", "calibrate_hand_eye", "calibrate_settings"}) {
    EXPECT_THAT(run(tool + " --help"), endsWith(0, tool + " --"));
    EXPECT_THAT(run(tool), endsWith(2, "is missing; see --help"));
    EXPECT_THAT(run(tool + " --speed 9"), endsWith(2, "--speed: no such option"));
    EXPECT_THAT(run(tool + " images"), endsWith(2, "options begin with --"));
    EXPECT_THAT(run(tool + " --output"), endsWith(2, "its value is missing"));
  }
  EXPECT_THAT(run("calibrate_stereo --images a --board 9 --square 0.025 --output b"), endsWith(2, "such as 9x6"));
  EXPECT_THAT(run("calibrate_stereo --images a --board 9x6 --square 25mm --output b"), endsWith(2, "not a number"));
  EXPECT_THAT(run("calibrate_stereo --images a --images a --board 9x6"), endsWith(2, "given twice"));
  EXPECT_THAT(run("calibrate_stereo --images /nowhere --board 9x6 --square 0.025 --output b"),
              endsWith(1, "/nowhere: no such folder"));
  EXPECT_THAT(run("calibrate_settings --manifest /nowhere --output b"), endsWith(1, "/nowhere: no such file"));
}

TEST(Tools, CalibrateStereoOnEverySecondRealPair) {
  const ScratchFolder folder;
  const std::string command =
      "calibrate_stereo --images " + realChessboards() + " --board 9x6 --square 0.025 --output " + folder.file("out");
  EXPECT_THAT(run(command + " --views 01,02,99"), endsWith(2, "there is no usable view 99"));
  EXPECT_THAT(run(command + " --views 01,02,03"), endsWith(1, "verdict: useless: only 3 usable pairs"));
  EXPECT_THAT(run(command + " --model fisheye"), endsWith(2, "--model is 'fisheye'; plumb_bob, rational_polynomial"));
  EXPECT_FALSE(std::filesystem::exists(folder.file("out")));
  for (const std::string views : {"odd", "even"}) {
    const auto outcome = run(command + " --views " + views);
    ASSERT_THAT(outcome, endsWith(0, "cross-validated k1 "));
    EXPECT_THAT(outcome.text, testing::HasSubstr("\nverdict: "));
    EXPECT_THAT(outcome.text, testing::Not(testing::HasSubstr("useless")));
    const YAML::Node report = YAML::LoadFile(folder.file("out/report.yaml"));
    EXPECT_THAT(report["verdict"].as<std::string>(), testing::AnyOf("good", "doubtful"));
    EXPECT_LE(report["checked"]["reprojection_rms_px"].as<double>(), 0.315);
    EXPECT_LE(report["checked"]["epipolar_rms_px"].as<double>(), 0.2);
    EXPECT_LE(report["checked"]["corner_spacing_error_mm"].as<double>(), 0.15);
    EXPECT_EQ(report["checked"]["views"].size() + report["used"]["views"].size(), kRealViews.size());
    const auto model = readStereoModelYaml(folder.file("out/left.yaml"), folder.file("out/right.yaml"));
    EXPECT_NEAR(model.baseline(), 0.0833, 0.0005);
    const StereoResiduals residuals = readStereoResiduals(folder.file("out/report.yaml"));
    EXPECT_NEAR(residuals.baseline, model.baseline(), 1e-6);
    EXPECT_EQ(residuals.focal_length, report["left"]["focal_length_px"].as<double>());
    EXPECT_EQ(residuals.focal_deviation, report["focal_length_deviation_percent"].as<double>() / 100);
    EXPECT_GT(residuals.epipolar_rms, 0.05);
    EXPECT_LT(residuals.epipolar_rms, 0.3);
  }
}

TEST(Tools, CalibrateHandEyeFromRenderedImages) {
  const ScratchFolder folder;
  SimulatedHandEye truth;
  truth.left.size = {640, 480};
  truth.left.K = {1650, 0, 325, 0, 1645, 237, 0, 0, 1};
  truth.left.P = {1650, 0, 325, 0, 0, 1650, 237, 0, 0, 0, 1, 0};
  writeCameraInfoYaml(folder.file("left.yaml"), {"left", truth.left});
  std::mt19937 random(11);
  std::ofstream table(folder.file("poses.csv"));
  table.precision(12);
  table << "image,x,y,z,qx,qy,qz,qw\n";
  int number = 0;
  for (const auto& T_left_board : truth.boardPoses(16, random)) {
    const std::string name = "view" + std::to_string(++number) + ".png";
    cv::imwrite(folder.file(name), cortshift_stereo_phantom::renderBoard(truth.left, T_left_board, truth.board));
    cv::Affine3d pose = SimulatedHandEye::tracked(truth.microscopePose(T_left_board), 0.05e-3, 0.0003, random);
    if (number == 5) pose = pose.translate(cv::Vec3d(0.01, 0, 0.01));
    const Eigen::Quaterniond q(Eigen::AngleAxisd(
        cv::norm(pose.rvec()), Eigen::Vector3d(pose.rvec()[0], pose.rvec()[1], pose.rvec()[2]).normalized()));
    table << name << "," << pose.translation()[0] << "," << pose.translation()[1] << "," << pose.translation()[2] << ","
          << q.x() << "," << q.y() << "," << q.z() << "," << q.w() << "\n";
  }
  table.close();
  const std::string command = "calibrate_hand_eye --poses " + folder.file("poses.csv") + " --images " + folder.path() +
                              " --camera " + folder.file("left.yaml") + " --output " + folder.file("hand_eye.yaml");
  EXPECT_THAT(run(command + " --board 9x6 --square 0.006 --tracker-position-sd 1"), endsWith(2, "tracker_position_sd"));
  ASSERT_THAT(run(command + " --board 9x6 --square 0.006 --tracker-position-sd 0.00005 --tracker-rotation-sd 0.0003"),
              endsWith(0, "view view5.png left out"));
  EXPECT_THAT(YAML::LoadFile(folder.file("hand_eye.yaml"))["verdict"].as<std::string>(),
              testing::AnyOf("good", "doubtful"));
  const cv::Affine3d difference = truth.T_microscope_left.inv() * readHandEyeYaml(folder.file("hand_eye.yaml"));
  EXPECT_LT(cv::norm(difference.translation()), 0.25e-3);
  EXPECT_LT(cv::norm(difference.rvec()), 0.05 * CV_PI / 180);
  cv::imwrite(folder.file("view7.png"), cv::Mat(48, 64, CV_8UC1, cv::Scalar(9)));
  EXPECT_THAT(run(command + " --board 9x6 --square 0.006"), endsWith(1, "view7.png is 64x48 but"));
  std::filesystem::remove(folder.file("view7.png"));
  EXPECT_THAT(run(command + " --board 9x6 --square 0.006"), endsWith(1, "view7.png: no such image"));
}

/// Rendered pairs of one board and their manifest.
class RenderedSettings {
 public:
  RenderedSettings() {
    head_.size = {512, 384};
    const auto shot = [&](const MicroscopeSetting& setting, const std::string& name) {
      for (const Side side : {Side::kLeft, Side::kRight}) {
        const cv::Affine3d T_camera_board = head_.cameraPose(side, setting).inv() * T_left_board_;
        const CameraModel camera{head_.size, halfSize(head_.K(side, setting)), LensModel::kPlumbBob,
                                 head_.D(side, setting)};
        cv::imwrite(folder_.file((side == Side::kLeft ? "left_" : "right_") + name + ".png"),
                    cortshift_stereo_phantom::renderBoard(camera, T_camera_board, board_));
      }
    };
    shot(head_.reference, "reference");
    manifest_ =
        "reference: {magnification: 1.0, focal_length: 0.3}\nboards:\n  - board: 9x6\n"
        "    reference: {left: left_reference.png, right: right_reference.png}\n    views:\n";
    for (const double magnification : {0.8, 1.0, 1.3})
      for (const double focal_length : {0.26, 0.3, 0.35}) {
        const std::string name =
            std::to_string(cvRound(100 * magnification)) + "_" + std::to_string(cvRound(1000 * focal_length));
        shot({magnification, focal_length}, name);
        manifest_ += "      - {magnification: " + std::to_string(magnification) +
                     ", focal_length: " + std::to_string(focal_length) + ", left: left_" + name +
                     ".png, right: right_" + name + ".png}\n";
      }
  }

  Outcome calibrate(const std::string& manifest) const {
    std::ofstream(folder_.file("manifest.yaml")) << manifest;
    return run("calibrate_settings --manifest " + folder_.file("manifest.yaml") + " --output " + folder_.file("out"));
  }
  const std::string& manifest() const { return manifest_; }
  const ScratchFolder& folder() const { return folder_; }

  /// Largest distance between where the field and the truth carry the board's corners [px].
  double largestError(Side side, const SettingsWarp& warp, const MicroscopeSetting& setting) const {
    std::vector<cv::Point3d> points;
    for (const auto& corner : board_.points()) points.push_back(T_left_board_ * corner);
    const auto at_setting = project(side, setting, points), at_reference = project(side, head_.reference, points);
    double largest = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
      largest = std::max(largest, cv::norm(warp.toReference(at_setting[i], setting) - at_reference[i]));
    return largest;
  }

 private:
  static cv::Matx33d halfSize(const cv::Matx33d& K) { return cv::Matx33d(0.5, 0, 0, 0, 0.5, 0, 0, 0, 1) * K; }
  std::vector<cv::Point2d> project(Side side, const MicroscopeSetting& setting,
                                   const std::vector<cv::Point3d>& points) const {
    auto pixels = head_.project(side, setting, points);
    for (auto& pixel : pixels) pixel *= 0.5;
    return pixels;
  }

  ScratchFolder folder_;
  SimulatedZoomHead head_;
  Board board_{{9, 6}, 0.0042};
  cv::Affine3d T_left_board_{cv::Vec3d(0.06, -0.04, 0.03), cv::Vec3d(-0.017, -0.0105, 0.3)};
  std::string manifest_;
};

TEST(Tools, CalibrateSettingsFromRenderedImages) {
  const RenderedSettings rendered;
  const auto outcome = rendered.calibrate(rendered.manifest());
  ASSERT_THAT(outcome, endsWith(0, "on held-out settings"));
  const MicroscopeSetting setting{1.1, 0.32};
  const auto left = readSettingsWarp(rendered.folder().file("out/settings_left.yaml"));
  const auto right = readSettingsWarp(rendered.folder().file("out/settings_right.yaml"));
  std::printf("%slargest error at a setting between: left %.3f px, right %.3f px\n", outcome.text.c_str(),
              rendered.largestError(Side::kLeft, left, setting), rendered.largestError(Side::kRight, right, setting));
  EXPECT_LT(rendered.largestError(Side::kLeft, left, setting), 0.2);
  EXPECT_LT(rendered.largestError(Side::kRight, right, setting), 0.2);
  EXPECT_THROW(left.requireCovered({1.31, 0.3}), SettingNotCalibrated);
  const YAML::Node report = YAML::LoadFile(rendered.folder().file("out/settings_report.yaml"));
  EXPECT_EQ(report["left"]["views"].size(), 9U);
  EXPECT_EQ(report["verdict"].as<std::string>(), "doubtful") << "one small board covers little of the image";
  EXPECT_THAT(outcome.text, testing::HasSubstr("\nverdict: doubtful: left: boards cover"));
  EXPECT_LT(report["right"]["held_out_rms_px"].as<double>(), 0.2);
  const SettingsResiduals residuals = readSettingsResiduals(rendered.folder().file("out/settings_report.yaml"));
  EXPECT_EQ(residuals.reference.focal_length, 0.3);
  EXPECT_NEAR(
      residuals.disparity_rms,
      std::hypot(report["left"]["held_out_rms_px"].as<double>(), report["right"]["held_out_rms_px"].as<double>()) /
          std::sqrt(2),
      1e-9);
}

TEST(Tools, CalibrateSettingsNamesFaultsOfTheManifest) {
  const RenderedSettings rendered;
  const auto spoiled = [&](const std::string& from, const std::string& to) {
    std::string manifest = rendered.manifest();
    manifest.replace(manifest.find(from), from.size(), to);
    return rendered.calibrate(manifest);
  };
  EXPECT_THAT(spoiled("right: right_80_350.png", ""), endsWith(1, "boards[0].views[2]: right is missing"));
  EXPECT_THAT(spoiled("left: left_80_350", "leftt: left_80_350"), endsWith(1, "boards[0].views[2]: unknown key leftt"));
  EXPECT_THAT(spoiled("focal_length: 0.3}", "focal_length: 300}"), endsWith(1, "metres, not millimetres"));
  EXPECT_THAT(spoiled("reference: {magnification: 1.0, focal_length: 0.3}\n", ""), endsWith(1, "reference is missing"));
  EXPECT_THAT(spoiled("board: 9x6", "board: 9 by 6"), endsWith(1, "boards[0]: board '9 by 6'"));
  EXPECT_THAT(spoiled("board: 9x6", "board: 7x5"), endsWith(1, "left_reference.png: the whole 7x5 board is not seen"));
  EXPECT_THAT(spoiled("left_80_350.png", "left_80_351.png"), endsWith(1, "left_80_351.png: no such image"));
  EXPECT_THAT(rendered.calibrate("reference: ["), endsWith(1, "not readable as YAML"));
  EXPECT_THAT(rendered.calibrate("reference: {magnification: 1.0, focal_length: 0.3}\nboards: []\n"),
              endsWith(1, "boards is not a list with entries"));
  cv::imwrite(rendered.folder().file("right_130_300.png"), cv::Mat(384, 500, CV_8UC1, cv::Scalar(9)));
  EXPECT_THAT(rendered.calibrate(rendered.manifest()), endsWith(1, "right_130_300.png is 500x384"));
  cv::imwrite(rendered.folder().file("right_130_300.png"), cv::Mat(384, 512, CV_8UC1, cv::Scalar(9)));
  EXPECT_THAT(rendered.calibrate(rendered.manifest()), endsWith(0, "right_130_300.png left out: the whole 9x6 board"));
}

}  // namespace
}  // namespace cortshift_stereo
