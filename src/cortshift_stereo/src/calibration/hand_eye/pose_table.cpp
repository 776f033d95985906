#include "cortshift_stereo/calibration/hand_eye/pose_table.hpp"

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "calibration/rigid.hpp"

namespace cortshift_stereo {
namespace {

const char* const kHeader = "image,x,y,z,qx,qy,qz,qw";
constexpr std::size_t kColumns = 8;
constexpr double kFarthest = 10;  // [m]

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r");
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream stream(line);
  for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(trimmed(cell));
  if (!line.empty() && line.back() == ',') cells.emplace_back();
  return cells;
}

TrackedPose readRow(const std::vector<std::string>& cells, const std::string& place) {
  if (cells.size() != kColumns)
    throw CalibrationError(place + ": " + std::to_string(cells.size()) + " columns; the 8 columns are " + kHeader);
  if (cells[0].empty()) throw CalibrationError(place + ": the image's name is missing; write it or remove the line");
  std::array<double, 7> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const std::string& cell = cells[i + 1];
    char* end = nullptr;
    numbers[i] = std::strtod(cell.c_str(), &end);
    if (cell.empty() || *end != '\0' || !std::isfinite(numbers[i]))
      throw CalibrationError(place + ": '" + cell + "' in column " + std::to_string(i + 2) +
                             " is not a finite number; correct it or remove the line");
  }
  const cv::Vec3d position(numbers[0], numbers[1], numbers[2]);
  if (cv::norm(position) > kFarthest)
    throw CalibrationError(place + ": the microscope is " + std::to_string(cv::norm(position)) +
                           " m from the reference frame; positions are metres, not millimetres");
  const auto rotation = rotationFromQuaternion({numbers[3], numbers[4], numbers[5], numbers[6]});
  if (!rotation)
    throw CalibrationError(place +
                           ": qx,qy,qz,qw is not of unit length, so no rotation; correct it or remove the line");
  return {cells[0], {*rotation, position}};
}

}  // namespace

std::vector<TrackedPose> readPoseTable(const std::string& path) {
  if (!std::filesystem::is_regular_file(path))
    throw CalibrationError(path + ": no such file; give a table with the header " + kHeader);
  std::ifstream file(path);
  std::vector<TrackedPose> poses;
  std::set<std::string> images;
  int line_number = 0;
  for (std::string line; std::getline(file, line);) {
    const std::string place = path + " line " + std::to_string(++line_number);
    line = trimmed(line);
    if (line_number == 1) {
      if (line != kHeader) throw CalibrationError(place + ": the header is '" + line + "'; it must be " + kHeader);
      continue;
    }
    if (line.empty()) continue;
    poses.push_back(readRow(split(line), place));
    if (!images.insert(poses.back().image).second)
      throw CalibrationError(place + ": image " + poses.back().image + " has a row already; remove one");
  }
  if (poses.empty()) throw CalibrationError(path + ": no poses in it; write one line per image under " + kHeader);
  return poses;
}

}  // namespace cortshift_stereo
