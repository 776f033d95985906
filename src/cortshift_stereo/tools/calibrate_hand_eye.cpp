// Tracked poses and images of a fixed board to the pose of the left camera in the microscope's tracked body.
#include <cstdio>
#include <filesystem>

#include "cortshift_stereo/calibration/camera_info_yaml.hpp"
#include "cortshift_stereo/calibration/hand_eye/hand_eye_verdict.hpp"
#include "cortshift_stereo/calibration/hand_eye/hand_eye_yaml.hpp"
#include "cortshift_stereo/calibration/hand_eye/pose_table.hpp"
#include "cortshift_stereo/calibration/stereo/stereo_report.hpp"
#include "cortshift_stereo/command_line.hpp"

namespace cortshift_stereo {
namespace {

constexpr double kMillimetre = 1e-3;
constexpr double kDegree = CV_PI / 180;

const char* const kHelp =
    R"(calibrate_hand_eye --poses poses.csv --images DIR --camera left.yaml --board 9x6 --square 0.025
                   --output hand_eye.yaml [--tracker-position-sd 0.00025] [--tracker-rotation-sd 0.00175]

Find the pose of the left camera in the microscope's tracked body from images of a board that stays where it is.

  --poses FILE   table with the header image,x,y,z,qx,qy,qz,qw: file name of a raw left image, position [m] and unit
                 quaternion of the microscope in the reference frame when it was taken
  --images DIR   folder of those images
  --camera FILE  left.yaml of calibrate_stereo, at the same microscope settings
  --board WxH    inner corners of the board, one count odd and one even, so that its two ends differ
  --square S     side of a square [m]
  --output FILE  gets translation, rotation, residuals, rotation diversity and rejected views (YAML)
  --tracker-position-sd, --tracker-rotation-sd
                 the tracker's accuracy per axis [m], [rad]

Take 30 to 40 views with the microscope tilted by up to 30 degrees in all directions and turned about its axis.
With a tracker of 0.25 mm and 0.1 degrees the camera's place is then known to about 0.15 mm. The lens is the one that the
camera's file names. The last line is the verdict: good, doubtful or useless, and what to do. A useless calibration is not
written.
Exit: 0 done, 1 failed or useless, 2 bad usage.
)";

void run(const Options& options) {
  HandEyeReport report;
  try {
    report.board = Board::parse(options.required("board"), options.requiredNumber("square"));
    report.settings.tracker_position_sd = options.number("tracker-position-sd", report.settings.tracker_position_sd);
    report.settings.tracker_rotation_sd = options.number("tracker-rotation-sd", report.settings.tracker_rotation_sd);
    report.settings.validate();
  } catch (const CalibrationError& fault) {
    throw UsageError(fault.what());
  }
  report.date = dateNow();
  report.images = options.required("images");
  report.camera = options.required("camera");
  const std::string output = options.required("output");
  const std::string table = options.required("poses");
  const CameraModel left = readCameraInfoYaml(report.camera).model;

  std::vector<HandEyeView> views;
  std::vector<RejectedView> without_board;
  const auto poses = readPoseTable(table);
  const auto progress = progressBar("finding boards");
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::string path = (std::filesystem::path(report.images) / poses[i].image).string();
    const cv::Mat image = readGreyImage(path);
    if (image.size() != left.size)
      throw CalibrationError(path + " is " + std::to_string(image.cols) + "x" + std::to_string(image.rows) + " but " +
                             report.camera + " is for " + std::to_string(left.size.width) + "x" +
                             std::to_string(left.size.height) + "; give the camera's own calibration");
    if (auto corners = findBoard(image, report.board))
      views.push_back({poses[i].image, poses[i].T_reference_microscope, std::move(*corners)});
    else
      without_board.push_back({poses[i].image, "the whole " + report.board.name() + " board is not seen"});
    if (progress) progress(static_cast<double>(i + 1) / static_cast<double>(poses.size()));
  }
  if (views.empty())
    throw CalibrationError(report.images + ": no " + report.board.name() + " board in any of the " +
                           std::to_string(poses.size()) +
                           " images; count its inner corners (where four squares meet), not its squares");
  try {
    report.calibration = calibrateHandEye(left, report.board, views, report.settings);
  } catch (const CalibrationError& fault) {
    throw CalibrationError(std::string("verdict: useless: ") + fault.what());
  }
  auto& rejected = report.calibration.rejected;
  rejected.insert(rejected.begin(), without_board.begin(), without_board.end());
  report.verdict = judgeHandEye(report.calibration);
  const bool useless = report.verdict.grade() == Grade::kUseless;
  if (!useless) writeHandEyeYaml(output, report);

  const auto& calibration = report.calibration;
  for (const auto& view : rejected) std::printf("view %s left out: %s\n", view.name.c_str(), view.reason.c_str());
  for (const auto& method : calibration.methods)
    std::printf("%-11s differs by %.3f mm, %.4f deg from the refined pose\n", method.method.c_str(),
                method.translation_difference / kMillimetre, method.rotation_difference / kDegree);
  std::printf("%zu views, rotation diversity %.1f, %.1f, %.1f deg, reprojection %.2f px with the tracked poses\n",
              calibration.residuals.size(), calibration.rotation_diversity[0] / kDegree,
              calibration.rotation_diversity[1] / kDegree, calibration.rotation_diversity[2] / kDegree,
              calibration.reprojection_rms);
  std::printf("standard deviation %.3f mm, %.4f deg\n%s%s\n%s\n", cv::norm(calibration.position_sd) / kMillimetre,
              cv::norm(calibration.rotation_sd) / kDegree, useless ? "did not write " : "wrote ", output.c_str(),
              report.verdict.line().c_str());
  if (useless) throw CalibrationError("the calibration is useless");
}

}  // namespace
}  // namespace cortshift_stereo

int main(int argc, char** argv) {
  using namespace cortshift_stereo;
  return runTool(
      argc, argv, kHelp,
      {"poses", "images", "camera", "board", "square", "output", "tracker-position-sd", "tracker-rotation-sd"}, run);
}
