#include "cortshift_stereo/calibration/hand_eye/pose_table.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>

#include "calibration/rigid.hpp"

namespace cortshift_stereo {
namespace {

const char* const kHeader = "image,x,y,z,qx,qy,qz,qw";
constexpr std::size_t kColumns = 8;
constexpr double kFarthest = 10;  // [m]

/// Lines and columns as people's programs write them; the rules are those of texts.py of cortshift_tracking.
struct Line {
  int number;
  std::string text;
};

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t");
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

/// Text of a file without the mark of UTF-8. @throws CalibrationError where it is no text
std::string readText(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  if (text.rfind("\xef\xbb\xbf", 0) == 0) text.erase(0, 3);
  if (text.find('\0') != std::string::npos || text.rfind("\xff\xfe", 0) == 0 || text.rfind("\xfe\xff", 0) == 0)
    throw CalibrationError(path + ": is not a text file in UTF-8; save it as CSV in UTF-8");
  return text;
}

/// Ended by \n, \r\n or \r, without the line `sep=;` that spreadsheets write for spreadsheets.
std::vector<Line> linesOf(const std::string& text) {
  std::vector<Line> lines;
  int number = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find_first_of("\r\n", begin), text.size());
    const std::string line = text.substr(begin, end - begin);
    ++number;
    if (number != 1 || (line.rfind("sep=", 0) != 0 && line.rfind("SEP=", 0) != 0)) lines.push_back({number, line});
    begin = end + (text.compare(end, 2, "\r\n") == 0 ? 2 : 1);
  }
  return lines;
}

/// What separates the columns: of commas, semicolons and tabs what the header has most of.
char separatorOf(const std::string& header) {
  char best = ',';
  for (const char one : {';', '\t'})
    if (std::count(header.begin(), header.end(), one) > std::count(header.begin(), header.end(), best)) best = one;
  return best;
}

/// Cells without blanks around them and without their quotation marks. @throws CalibrationError
std::vector<std::string> split(const std::string& line, char separator, const std::string& place) {
  std::vector<std::string> cells;
  for (std::size_t at = 0; at <= line.size(); ++at) {
    const std::size_t first = line.find_first_not_of(separator == '\t' ? " " : " \t", at);
    if (first == std::string::npos || line[first] != '"') {
      const std::size_t end = std::min(line.find(separator, at), line.size());
      cells.push_back(trimmed(line.substr(at, end - at)));
      at = end;
      continue;
    }
    std::string cell;
    for (at = first + 1; at < line.size(); ++at) {
      if (line[at] == '"' && line.compare(at, 2, "\"\"") != 0) break;
      if (line[at] == '"') ++at;  // two stand for one
      cell += line[at];
    }
    const std::size_t end = std::min(line.find(separator, at), line.size());
    if (at >= line.size() || !trimmed(line.substr(at + 1, end - at - 1)).empty())
      throw CalibrationError(place + ": a cell begins with a quotation mark and does not end with one; correct it");
    cells.push_back(trimmed(cell));
    at = end;
  }
  return cells;
}

/// Spreadsheets add separators with nothing behind them.
void dropEmptyBeyond(std::vector<std::string>& cells, std::size_t columns) {
  while (cells.size() > columns && cells.back().empty()) cells.pop_back();
}

/// What cannot be seen, such as a blank that is none, as \xNN.
std::string visible(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c >= ' ' && c <= '~') {
      out += c;
      continue;
    }
    char code[5];
    std::snprintf(code, sizeof code, "\\x%02x", static_cast<unsigned>(static_cast<unsigned char>(c)));
    out += code;
  }
  return out;
}

std::string joined(const std::vector<std::string>& cells) {
  std::string out;
  for (const std::string& cell : cells) out += (out.empty() ? "" : ",") + cell;
  return out;
}

/// Finite, with a decimal comma too where no comma separates; else nothing.
std::optional<double> numberOf(std::string cell, char separator) {
  if (separator != ',') std::replace(cell.begin(), cell.end(), ',', '.');
  char* end = nullptr;
  const double number = std::strtod(cell.c_str(), &end);
  if (cell.empty() || *end != '\0' || !std::isfinite(number)) return std::nullopt;
  return number;
}

TrackedPose readRow(const std::vector<std::string>& cells, char separator, const std::string& place) {
  const std::string decimal =
      separator == ',' ? "; numbers with decimal commas need semicolons or tabs between the columns" : "";
  if (cells.size() != kColumns)
    throw CalibrationError(place + ": " + std::to_string(cells.size()) + " columns; the 8 columns are " + kHeader +
                           ", separated as in the header" + (cells.size() > kColumns ? decimal : ""));
  if (cells[0].empty()) throw CalibrationError(place + ": the image's name is missing; write it or remove the line");
  std::array<double, 7> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const std::string& cell = cells[i + 1];
    const std::optional<double> number = numberOf(cell, separator);
    if (!number)
      throw CalibrationError(place + ": '" + visible(cell) + "' in column " + std::to_string(i + 2) +
                             " is not a finite number; correct it or remove the line" +
                             (cell.find(',') != std::string::npos ? decimal : ""));
    numbers[i] = *number;
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
  std::vector<TrackedPose> poses;
  std::set<std::string> images;
  std::optional<char> separator;  // as the header has it
  for (const Line& line : linesOf(readText(path))) {
    if (trimmed(line.text).empty()) continue;
    const std::string place = path + " line " + std::to_string(line.number);
    const bool is_header = !separator;
    if (is_header) separator = separatorOf(line.text);
    std::vector<std::string> cells = split(line.text, *separator, place);
    dropEmptyBeyond(cells, is_header ? 0 : kColumns);
    if (is_header) {
      if (joined(cells) != kHeader)
        throw CalibrationError(place + ": the header is '" + visible(line.text) + "'; it must be " + kHeader);
      continue;
    }
    if (std::all_of(cells.begin(), cells.end(), [](const std::string& cell) { return cell.empty(); })) continue;
    poses.push_back(readRow(cells, *separator, place));
    if (!images.insert(poses.back().image).second)
      throw CalibrationError(place + ": image " + poses.back().image + " has a row already; remove one");
  }
  if (poses.empty()) throw CalibrationError(path + ": no poses in it; write one line per image under " + kHeader);
  return poses;
}

}  // namespace cortshift_stereo
