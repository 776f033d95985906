#include "cortshift_stereo/calibration/hand_eye/pose_table.hpp"

#include <gmock/gmock.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <fstream>

#include "cortshift_stereo/calibration/hand_eye/hand_eye_yaml.hpp"
#include "scratch_folder.hpp"

namespace cortshift_stereo {
namespace {

const std::string kHeader = "image,x,y,z,qx,qy,qz,qw\n";

std::string written(const ScratchFolder& folder, const std::string& text) {
  const std::string path = folder.file("poses.csv");
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

std::string refusal(const std::string& text) {
  const ScratchFolder folder;
  const std::string path = written(folder, text);
  try {
    readPoseTable(path);
  } catch (const CalibrationError& fault) {
    EXPECT_THAT(fault.what(), testing::HasSubstr(path));
    return fault.what();
  }
  return "not refused";
}

TEST(PoseTable, ReadsPosesInOrder) {
  const ScratchFolder folder;
  const auto poses =
      readPoseTable(written(folder, kHeader + "a.png,0.1,0.2,0.3,0,0,0,1\r\n\n b 2.png , 1,2,3, 0.6,0,0,-0.8\n"));
  ASSERT_EQ(poses.size(), 2U);
  EXPECT_EQ(poses[0].image, "a.png");
  EXPECT_EQ(poses[0].T_reference_microscope.translation(), cv::Vec3d(0.1, 0.2, 0.3));
  EXPECT_EQ(poses[1].image, "b 2.png");
  EXPECT_NEAR(poses[1].T_reference_microscope.rvec()[0], -2 * std::atan2(0.6, 0.8), 1e-12);
}

TEST(PoseTable, ReadsWhatSpreadsheetsAndPeopleWrite) {
  const std::string columns = "image;x;y;z;qx;qy;qz;qw";
  const auto with = [](std::string text, char separator) {
    std::replace(text.begin(), text.end(), ';', separator);
    return text;
  };
  const std::vector<std::pair<std::string, std::string>> tables = {
      {"mark of UTF-8", "\xef\xbb\xbf" + kHeader + "a.png,0.1,-0.2,0.3,0,0,0.6,0.8\nb.png,1,2,3,0,0,0,1\n"},
      {"decimal commas", columns + "\na.png;0,1;-0,2;0,3;0;0;0,6;0,8\nb.png;1;2;3;0;0;0;1\n"},
      {"decimal points", columns + "\na.png;0.1;-0.2;0.3;0;0;0.6;0.8\nb.png;1;2;3;0;0;0;1\n"},
      {"tabs", with(columns + "\na.png;0,1;-0,2;0,3;0;0;0.6;8e-1\nb.png;1;2;3;0;0;0;1\n", '\t')},
      {"quoted",
       "\"image\",\"x\",\"y\",\"z\",\"qx\",\"qy\",\"qz\",\"qw\"\n\"a.png\",\"0.1\",\"-0.2\", \"0.3\" "
       ",0,0,0.6,0.8\n\"b.png\",1,2,3,0,0,0,\"1\"\n"},
      {"blanks", "image, x, y, z, qx, qy, qz, qw\na.png, 0.1, -0.2, 0.3, 0, 0, 0.6, 0.8\nb.png, 1,2,3,0,0,0, 1\n"},
      {"empty cells at the end",
       "image,x,y,z,qx,qy,qz,qw,\na.png,0.1,-0.2,0.3,0,0,0.6,0.8,,\nb.png,1,2,3,0,0,0,1\n,,,,,,,\n"},
      {"CR", "image,x,y,z,qx,qy,qz,qw\ra.png,0.1,-0.2,0.3,0,0,0.6,0.8\rb.png,1,2,3,0,0,0,1\r"},
      {"sep=", "\xef\xbb\xbfsep=;\r\n" + columns + "\r\na.png;0,1;-0,2;0,3;0;0;0,6;0,8\r\nb.png;1;2;3;0;0;0;1"}};
  const ScratchFolder folder;
  for (const auto& [what, text] : tables) {
    SCOPED_TRACE(what);
    const auto poses = readPoseTable(written(folder, text));
    ASSERT_EQ(poses.size(), 2U);
    EXPECT_EQ(poses[0].image, "a.png");
    EXPECT_EQ(poses[0].T_reference_microscope.translation(), cv::Vec3d(0.1, -0.2, 0.3));
    EXPECT_NEAR(poses[0].T_reference_microscope.rvec()[2], 2 * std::atan2(0.6, 0.8), 1e-12);
    EXPECT_EQ(poses[1].image, "b.png");
    EXPECT_EQ(poses[1].T_reference_microscope.translation(), cv::Vec3d(1, 2, 3));
  }
  EXPECT_EQ(readPoseTable(written(folder, kHeader + "\"a, \"\"b\"\".png\",0,0,0,0,0,0,1\n"))[0].image, "a, \"b\".png");
}

TEST(PoseTable, RefusesWhatIsAmbiguousByLineAndRemedy) {
  EXPECT_THAT(refusal(kHeader + "a,0,1,0,2,0,3,0,0,0,1\n"),
              testing::HasSubstr("line 2: 11 columns; the 8 columns are image,x,y,z,qx,qy,qz,qw, separated as in the "
                                 "header; numbers with decimal commas need semicolons or tabs between the columns"));
  EXPECT_THAT(
      refusal(kHeader + "a,\"0,1\",0,0,0,0,0,1\n"),
      testing::HasSubstr("line 2: '0,1' in column 2 is not a finite number; correct it or remove the line; numbers "
                         "with decimal commas need semicolons or tabs"));
  EXPECT_THAT(refusal("image;x;y;z;qx;qy;qz;qw\na;1.234,5;0;0;0;0;0;1\n"), testing::HasSubstr("'1.234,5' in column 2"));
  EXPECT_THAT(refusal(kHeader + "a;0;0;0;0;0;0;1\n"), testing::HasSubstr("line 2: 1 columns; the 8 columns are"));
  EXPECT_THAT(refusal(kHeader + "\"a,0,0,0,0,0,0,1\n"),
              testing::HasSubstr("line 2: a cell begins with a quotation mark"));
  EXPECT_THAT(refusal(kHeader + "\"a\"b,0,0,0,0,0,0,1\n"), testing::HasSubstr("does not end with one; correct it"));
  EXPECT_THAT(refusal("image,x,y,z,qx,qy,qz,qw\xc2\xa0\n"),
              testing::HasSubstr("the header is 'image,x,y,z,qx,qy,qz,qw\\xc2\\xa0'"));
  EXPECT_THAT(refusal(std::string("\xff\xfei\0m\0", 6)),
              testing::HasSubstr("is not a text file in UTF-8; save it as CSV in UTF-8"));
}

TEST(PoseTable, RefusesFaultsByFileAndLine) {
  EXPECT_THAT(refusal("image,x,y,z,qw,qx,qy,qz\n"), testing::HasSubstr("line 1: the header is"));
  EXPECT_THAT(refusal(kHeader), testing::HasSubstr("no poses in it"));
  EXPECT_THAT(refusal(kHeader + "a,0,0,0,0,0,0,1\nb,0,0,0,0,0,1\n"), testing::HasSubstr("line 3: 7 columns"));
  EXPECT_THAT(refusal(kHeader + "a,0,0,zero,0,0,0,1\n"), testing::HasSubstr("line 2: 'zero' in column 4"));
  EXPECT_THAT(refusal(kHeader + "a,0,0,nan,0,0,0,1\n"), testing::HasSubstr("'nan' in column 4"));
  EXPECT_THAT(refusal(kHeader + "a,0,0,0,0,0,0,\n"), testing::HasSubstr("'' in column 8"));
  EXPECT_THAT(refusal(kHeader + "a,0,0,0,0,0,0,0\n"), testing::HasSubstr("line 2: qx,qy,qz,qw is not of unit length"));
  EXPECT_THAT(refusal(kHeader + "a,0,0,0,0.5,0.5,0.5,0.6\n"), testing::HasSubstr("not of unit length"));
  EXPECT_THAT(refusal(kHeader + "a,100,200,50,0,0,0,1\n"), testing::HasSubstr("metres, not millimetres"));
  EXPECT_THAT(refusal(kHeader + "a,0,0,0,0,0,0,1\na,0,0,0,0,0,0,1\n"), testing::HasSubstr("line 3: image a has a row"));
  EXPECT_THAT(refusal(kHeader + ",0,0,0,0,0,0,1\n"), testing::HasSubstr("name is missing"));
  EXPECT_THROW(readPoseTable("/nowhere/poses.csv"), CalibrationError);
}

TEST(HandEyeYaml, ReadsBackItsPoseAndRefusesOthers) {
  const ScratchFolder folder;
  HandEyeReport report;
  report.board = {{9, 6}, 0.006};
  report.calibration.T_microscope_left = cv::Affine3d(cv::Vec3d(0.1, -2.5, 1.0), cv::Vec3d(0.1, 0.2, -0.3));
  report.calibration.position_sd = {3e-4, 4e-4, 0};
  report.calibration.rotation_sd = {1e-3, 0, 2e-3};
  report.calibration.rejected.push_back({"a.png", "blurred"});
  const std::string path = folder.file("hand_eye.yaml");
  writeHandEyeYaml(path, report);
  const HandEyeDeviation deviation = readHandEyeDeviation(path);
  EXPECT_NEAR(deviation.translation_sd, cv::norm(report.calibration.position_sd) / std::sqrt(3.0), 1e-6);
  EXPECT_NEAR(deviation.rotation_sd, cv::norm(report.calibration.rotation_sd) / std::sqrt(3.0), 1e-6);
  const cv::Affine3d difference = report.calibration.T_microscope_left.inv() * readHandEyeYaml(path);
  EXPECT_LT(cv::norm(difference.rvec()), 1e-12);
  EXPECT_LT(cv::norm(difference.translation()), 1e-12);
  const auto refused = [&](const std::string& text) -> std::string {
    std::ofstream(path) << text;
    try {
      readHandEyeYaml(path);
    } catch (const CalibrationError& fault) {
      EXPECT_THAT(fault.what(), testing::HasSubstr(path));
      return fault.what();
    }
    return "not refused";
  };
  const std::string frames = "parent_frame: microscope\nchild_frame: left_optical\n";
  EXPECT_THAT(refused(frames + "translation: [0, 0, 0]\nrotation: [0, 0, 0, 2]\n"),
              testing::HasSubstr("unit quaternion"));
  EXPECT_THAT(refused(frames + "translation: [0, 0, 0]\n"), testing::HasSubstr("rotation is missing"));
  EXPECT_THAT(refused(frames + "translation: [0, 0]\nrotation: [0, 0, 0, 1]\n"), testing::HasSubstr("3 numbers"));
  EXPECT_THAT(refused("parent_frame: left_optical\nchild_frame: microscope\ntranslation: [0, 0, 0]\n"),
              testing::HasSubstr("it is the pose of microscope in left_optical"));
}

TEST(HandEyeYaml, EveryNumberStandsUnderItsKey) {
  const ScratchFolder folder;
  HandEyeReport report;
  report.date = "2014-01-02T03:04:05Z";
  report.images = "views: of Monday";
  report.camera = "left.yaml";
  report.board = {{9, 6}, 0.0042};
  report.settings = {0.0003, 0.2 * CV_PI / 180, 0.1};
  HandEyeCalibration& calibration = report.calibration;
  calibration.position_sd = {0.1e-3, 0.2e-3, 0.3e-3};
  calibration.rotation_sd = cv::Vec3d(0.01, 0.02, 0.03) * (CV_PI / 180);
  calibration.rotation_diversity = cv::Vec3d(21, 12, 3) * (CV_PI / 180);
  calibration.misfit = 1.25;
  calibration.reprojection_rms = 2.5;
  calibration.method_spread = 0.7e-3;
  calibration.methods = {{"Tsai", {}, 0.4e-3, 0.05 * CV_PI / 180}};
  calibration.residuals = {{"a.png", 0.31, 0.6e-3, 0.07 * CV_PI / 180}};
  calibration.rejected = {{"b.png", "blurred"}};
  writeHandEyeYaml(folder.file("hand_eye.yaml"), report);
  const YAML::Node read = YAML::LoadFile(folder.file("hand_eye.yaml"));
  const auto numbers = [&](const char* key) { return read[key].as<std::vector<double>>(); };
  EXPECT_EQ(read["date"].as<std::string>(), report.date);
  EXPECT_EQ(read["images"].as<std::string>(), report.images);
  EXPECT_EQ(read["camera"].as<std::string>(), report.camera);
  EXPECT_EQ(read["board"]["inner_corners"].as<std::string>(), "9x6");
  EXPECT_EQ(read["board"]["square_mm"].as<std::string>(), "4.2");
  EXPECT_THAT(numbers("translation_deviation_mm"), testing::ElementsAre(0.1, 0.2, 0.3));
  EXPECT_THAT(numbers("rotation_deviation_deg"), testing::ElementsAre(0.01, 0.02, 0.03));
  EXPECT_THAT(numbers("rotation_diversity_deg"), testing::ElementsAre(21, 12, 3));
  EXPECT_EQ(read["tracker_assumed"]["position_sd_mm"].as<double>(), 0.3);
  EXPECT_EQ(read["tracker_assumed"]["rotation_sd_deg"].as<double>(), 0.2);
  EXPECT_EQ(read["misfit"].as<double>(), 1.25);
  EXPECT_EQ(read["reprojection_rms_px"].as<double>(), 2.5);
  EXPECT_EQ(read["method_spread_mm"].as<double>(), 0.7);
  EXPECT_EQ(read["methods"][0]["name"].as<std::string>(), "Tsai");
  EXPECT_EQ(read["methods"][0]["translation_difference_mm"].as<double>(), 0.4);
  EXPECT_EQ(read["methods"][0]["rotation_difference_deg"].as<double>(), 0.05);
  EXPECT_EQ(read["views"][0]["name"].as<std::string>(), "a.png");
  EXPECT_EQ(read["views"][0]["reprojection_rms_px"].as<double>(), 0.31);
  EXPECT_EQ(read["views"][0]["position_residual_mm"].as<double>(), 0.6);
  EXPECT_EQ(read["views"][0]["rotation_residual_deg"].as<double>(), 0.07);
  EXPECT_EQ(read["rejected"][0]["name"].as<std::string>(), "b.png");
  EXPECT_EQ(read["rejected"][0]["reason"].as<std::string>(), "blurred");
}

TEST(HandEyeSettings, WhatIsOutOfRangeIsNamedWithWhatIsAllowed) {
  const auto refusal = [](const HandEyeSettings& settings) -> std::string {
    try {
      settings.validate();
    } catch (const CalibrationError& fault) {
      return fault.what();
    }
    return "";
  };
  EXPECT_EQ(refusal({}), "");
  EXPECT_EQ(refusal({7, 0.01, 0.1}), "tracker_position_sd [m] = 7 is not allowed; allowed is 1e-06 ... 0.02");
  EXPECT_EQ(refusal({1e-3, 0, 0.1}), "tracker_rotation_sd [rad] = 0 is not allowed; allowed is 1e-06 ... 0.1");
  EXPECT_EQ(refusal({1e-3, 0.01, 11}), "corner_sd [px] = 11 is not allowed; allowed is 0.001 ... 10");
}

}  // namespace
}  // namespace cortshift_stereo
