#include "cortshift_stereo/calibration/camera_info_yaml.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/calib3d.hpp>
#include <sstream>

#include "scratch_folder.hpp"

namespace cortshift_stereo {
namespace {

NamedCamera someCamera(double baseline) {
  NamedCamera camera;
  camera.name = "left: of the pair";
  camera.model.size = {1024, 768};
  camera.model.K = {2000.1, 0, 511.3, 0, 1999.7, 383.9, 0, 0, 1};
  camera.model.D = {-0.1, 1.0 / 3.0, 1e-17, 0, 0.02};
  cv::Matx33d turn;
  cv::Rodrigues(cv::Vec3d(0.01, -0.05, 0.002), turn);
  camera.model.R = turn;
  camera.model.P = {2000, 0, 500, -2000 * baseline, 0, 2000, 380, 0, 0, 0, 1, 0};
  return camera;
}

std::string textOf(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

/// The message of the refusal to read a file in which `from` was replaced by `to`.
std::string refusal(const std::string& from, const std::string& to) {
  const ScratchFolder folder;
  const std::string path = folder.file("left.yaml");
  writeCameraInfoYaml(path, someCamera(0));
  std::string text = textOf(path);
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  std::ofstream(path) << text.replace(at, from.size(), to);
  try {
    readCameraInfoYaml(path);
  } catch (const CalibrationError& fault) {
    EXPECT_NE(std::string(fault.what()).find(path), std::string::npos) << fault.what();
    return fault.what();
  }
  return "not refused";
}

TEST(CameraInfoYaml, ReadsBackEveryNumberExactly) {
  const ScratchFolder folder;
  const NamedCamera written = someCamera(0.04);
  writeCameraInfoYaml(folder.file("right.yaml"), written, "first line\nsecond: line");
  const NamedCamera read = readCameraInfoYaml(folder.file("right.yaml"));
  EXPECT_EQ(read.name, written.name);
  EXPECT_EQ(read.model.size, written.model.size);
  EXPECT_EQ(read.model.K, written.model.K);
  EXPECT_EQ(read.model.D, written.model.D);
  EXPECT_EQ(read.model.R, written.model.R);
  EXPECT_EQ(read.model.P, written.model.P);
}

TEST(CameraInfoYaml, ReadsBackEveryLens) {
  const ScratchFolder folder;
  NamedCamera camera = someCamera(0);
  for (const auto& [lens, D] : {std::pair(LensModel::kRationalPolynomial,
                                          std::vector<double>{0.4, -0.2, 1e-4, -2e-4, 0.3, 0.6, 1.0 / 3, -0.05}),
                                std::pair(LensModel::kEquidistant, std::vector<double>{0.1, 1.0 / 7, -0.01, 0.3})}) {
    camera.model.lens = lens;
    camera.model.D = D;
    writeCameraInfoYaml(folder.file("left.yaml"), camera);
    const CameraModel read = readCameraInfoYaml(folder.file("left.yaml")).model;
    EXPECT_EQ(read.lens, lens);
    EXPECT_EQ(read.D, D);
  }
}

TEST(CameraInfoYaml, ReadsListsAndRowsAsSitesWriteThem) {
  const ScratchFolder folder;
  const auto read = [&](const std::string& text) {
    std::ofstream(folder.file("left.yaml")) << text;
    return readCameraInfoYaml(folder.file("left.yaml")).model;
  };
  // As `rostopic echo` prints a message, and with rows; both say the same camera.
  const CameraModel flat = read(
      "header: {seq: 0, frame_id: left_optical}\nheight: 480\nwidth: 640\ndistortion_model: rational_polynomial\n"
      "D: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]\nK: [600.0, 0, 320, 0, 601, 240, 0, 0, 1]\n"
      "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nP: [500, 0, 320, -20, 0, 500, 240, 0, 0, 0, 1, 0]\nbinning_x: 0\n"
      "roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: False}\n---\n");
  const CameraModel rows = read(
      "image_width: 640\nimage_height: 480\ncamera_name: left\ndistortion_model: rational_polynomial\n"
      "camera_matrix: [[600.0, 0, 320], [0, 601, 240], [0, 0, 1]]\n"
      "distortion_coefficients: [[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]]\n"
      "rectification_matrix: {data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
      "projection_matrix:\n  data:\n    - [500, 0, 320, -20]\n    - [0, 500, 240, 0]\n    - [0, 0, 1, 0]\n");
  for (const CameraModel* camera : {&flat, &rows}) {
    EXPECT_EQ(camera->size, cv::Size(640, 480));
    EXPECT_EQ(camera->lens, LensModel::kRationalPolynomial);
    EXPECT_EQ(camera->D, std::vector<double>({0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8}));
    EXPECT_EQ(camera->K, cv::Matx33d(600, 0, 320, 0, 601, 240, 0, 0, 1));
    EXPECT_EQ(camera->P, cv::Matx34d(500, 0, 320, -20, 0, 500, 240, 0, 0, 0, 1, 0));
  }
  EXPECT_THROW(read("image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\nD: []\n"
                    "K: [[600, 0, 320, 0, 601, 240, 0, 0, 1]]\n"),
               CalibrationError)
      << "nine numbers in one row are no 3x3 matrix";
}

TEST(CameraInfoYaml, ReadsBothSidesAndChecksThatTheyBelongTogether) {
  const ScratchFolder folder;
  writeCameraInfoYaml(folder.file("left.yaml"), someCamera(0));
  writeCameraInfoYaml(folder.file("right.yaml"), someCamera(0.04));
  EXPECT_DOUBLE_EQ(readStereoModelYaml(folder.file("left.yaml"), folder.file("right.yaml")).baseline(), 0.04);
  EXPECT_THROW(readStereoModelYaml(folder.file("left.yaml"), folder.file("left.yaml")), CalibrationError);
}

TEST(CameraInfoYaml, RefusesAFaultyFileByNameAndKey) {
  EXPECT_NE(refusal("camera_matrix", "camera_matrices").find("camera_matrix is missing"), std::string::npos);
  EXPECT_NE(refusal("plumb_bob", "fisheye").find("plumb_bob, rational_polynomial and equidistant are supported"),
            std::string::npos);
  EXPECT_NE(refusal("plumb_bob", "equidistant").find("distortion_coefficients has 5 values; equidistant has 4"),
            std::string::npos);
  EXPECT_NE(refusal("[-0.1, ", "[abc, ").find("distortion_coefficients holds something that is not a number"),
            std::string::npos);
  EXPECT_NE(refusal("distortion_model", "D: [0, 0, 0, 0, 0]\ndistortion_model").find("are both given"),
            std::string::npos);
  EXPECT_NE(refusal("camera_name", "binning_x: 2\ncamera_name").find("binning_x is 2"), std::string::npos);
  EXPECT_NE(refusal("[2000.1, 0, ", "[2000.1, ").find("camera_matrix is not 3x3"), std::string::npos);
  EXPECT_NE(refusal("2000.1", ".nan").find("not finite"), std::string::npos);
  EXPECT_NE(refusal("image_width: 1024", "image_width: wide").find("image_width"), std::string::npos);
  EXPECT_NE(refusal("image_width: 1024", "image_width: [").find("not readable as YAML"), std::string::npos);
}

TEST(CameraInfoYaml, RefusesAMissingFileAndAFolderThatCannotBeWritten) {
  EXPECT_THROW(readCameraInfoYaml("/nowhere/left.yaml"), CalibrationError);
  EXPECT_THROW(writeCameraInfoYaml("/nowhere/left.yaml", someCamera(0)), CalibrationError);
}

}  // namespace
}  // namespace cortshift_stereo
